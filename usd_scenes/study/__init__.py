"""A small furnished room under goniometric luminaires, in fewer than 500 polygons if wanted."""
