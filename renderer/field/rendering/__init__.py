"""A field to pictures: occupancy, ray marching, volume rendering."""
