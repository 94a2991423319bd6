"""Values and messages as rmw_desert spells them."""
