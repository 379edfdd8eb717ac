"""Recipes and what runs them: steps, folders, batches, workers."""
