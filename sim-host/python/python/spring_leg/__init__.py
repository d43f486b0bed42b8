"""A spring-legged hopper in water and on land: physics, controller, policies, environments.

With Gymnasium installed the import registers `spring_leg/Hopper-v0` (with the trainer's preset
`robust`; `preset=` chooses another), `spring_leg/HopperWater-v0`, `spring_leg/HopperAir-v0` and
`spring_leg/HopperField-v0`.
"""

from spring_leg._leg import Command, Controller, Leg, Plant, Policy, Sample, Ticks
from spring_leg.recording import read_recording

__all__ = [
    "Command",
    "Controller",
    "Leg",
    "Plant",
    "Policy",
    "Sample",
    "Ticks",
    "read_recording",
]


def _register() -> None:
    """Registers the environments, where Gymnasium is installed."""
    try:
        import gymnasium
    except ModuleNotFoundError as missing:
        if missing.name != "gymnasium":
            raise
        return
    presets = {"": "robust", "Water": "water", "Air": "air", "Field": "field"}
    for name, preset in presets.items():
        gymnasium.register(
            id=f"spring_leg/Hopper{name}-v0",
            entry_point="spring_leg.hopper:HopperEnv",
            vector_entry_point="spring_leg.hopper:HopperVectorEnv",
            kwargs={"preset": preset},
        )


_register()
