"""The matching method of Ait Aider, Hoppenot and Colle (2005) as written, with its errata corrected.

The reference that the default matcher is measured against. In the order of the paper: `selection` (2, 3.2),
`verticals` (3.2), `unary` and `binary` (3.2), `order` (appendix B), `errors` and `tables` (3.4), `trees` and
`combinations` (3.2, 3.6), `verification` and `distance` (3.3); `matcher` runs them all.
"""
