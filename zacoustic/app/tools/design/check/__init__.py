"""`zacoustic check`: a configuration as a table, before the dive.

`report` is the bytes and airtime of every stream, `bits` what a sample costs, `desert` the same for
rmw_desert's wire, `text` all of it for people.
"""
