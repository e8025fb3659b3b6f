"""``python -m clearjoint`` prints the runtime settings as shell variables (see `runtime`)."""

from .runtime import settings

for variable, setting in settings().items():
    print(f'export {variable}="{setting}"')
