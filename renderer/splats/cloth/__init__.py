"""Loose clothes: tubes of cloth that hang from a joint and swing, and the splats on them."""
