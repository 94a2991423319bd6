"""Values and messages as rmw_desert encodes them."""
