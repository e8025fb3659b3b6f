"""Backlash of one joint in clearjoint and by MuJoCo's recipe of two hinges."""
