"""Densities of common materials, kg/m^3, at room temperature, for `Body.rod` and the like.

Actual alloys deviate by a few percent. Source: Dubbel, Taschenbuch für den Maschinenbau, 25th ed.
2018, tables of materials.
"""

STEEL = 7850.0
STAINLESS_STEEL = 7900.0
CAST_IRON = 7200.0
ALUMINIUM = 2700.0
TITANIUM = 4500.0
MAGNESIUM = 1740.0
BRASS = 8500.0
BRONZE = 8800.0
COPPER = 8960.0
LEAD = 11340.0
POLYAMIDE = 1140.0
POLYOXYMETHYLENE = 1410.0
PTFE = 2200.0
ACRYLIC_GLASS = 1190.0
GLASS = 2500.0
RUBBER = 1100.0
