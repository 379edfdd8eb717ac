"""Recipes, runs and their outputs: what ties sources, stages and sinks together."""
