"""The repaired scene: what a verdict changes in the MJCF, and that it plays alike."""
