"""The paper's double pendulum as users of other tools would simulate it."""
