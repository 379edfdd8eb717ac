"""Pictures of layers."""
