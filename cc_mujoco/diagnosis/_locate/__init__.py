"""Structure of the error: where, when and along which quantity it lies."""
