"""Custom properties by which the add-on knows what it made."""

MADE_HERE = "obscurance_lightmap"  # of images: the name that the bake asked for
BAKED_LIGHT = "obscurance_attribute"  # of node groups that add baked light to a surface
