"""A flat of several rooms; see README.md."""
