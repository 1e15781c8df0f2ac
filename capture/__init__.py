"""The appliance: find the hanger and the garment in every frame and keep what was seen."""
