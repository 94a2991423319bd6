"""`zacoustic decode`: explains frames in words.

`decoder` takes frames apart, `overheard` follows their dense blocks, `opening` opens sealed ones,
`desert` reads those of rmw_desert, `decoded` is one item of a frame.
"""
