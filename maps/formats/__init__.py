"""Maps from elsewhere and to elsewhere: one module a format, and what they share."""
