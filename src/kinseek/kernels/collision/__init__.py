"""First looks at a scene: what is free or touches for sure."""
