"""Cable models that came before, and what each can show."""
