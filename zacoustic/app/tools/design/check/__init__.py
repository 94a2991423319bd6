"""`zacoustic config check`: a configuration as a table, before the dive.

`report` is the bytes and airtime of every stream, `bits` the cost of a sample, `desert` the same
for rmw_desert's wire, `text` the report in words.
"""
