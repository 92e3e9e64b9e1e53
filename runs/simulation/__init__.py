"""A simulator: drives through a building, what wheels, other sensors and a camera make of them."""
