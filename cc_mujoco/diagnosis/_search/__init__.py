"""Search for the effects that the model lacks, and the verdict."""
