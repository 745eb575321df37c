"""Reading glTF 2.0."""
