"""Backlash: one joint with play in clearjoint and by MuJoCo's recipe of two hinges."""
