"""Sessions and people: reading, running, results, recording, comparison, command line."""
