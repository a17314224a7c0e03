"""Cable models that came before, behind one interface."""
