"""How long a slider-crank's pin lives: profiles that wear, and derivatives of the life."""
