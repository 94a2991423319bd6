"""`zacoustic decode`: frames in words.

`decoder` takes frames apart, `overheard` follows the dense blocks among them, `desert` knows those
of rmw_desert, `decoded` is one item of a frame.
"""
