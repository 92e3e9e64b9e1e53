"""Faults for recorded sessions: what goes wrong with cameras, wheels, clocks and maps, seeded, one kind at a time."""
