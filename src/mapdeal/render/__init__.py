"""Pictures of layers for people to look at: arrays in, palette images out."""
