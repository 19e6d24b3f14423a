import bpy

settings = bpy.context.scene.obscurance

settings.use_bleeding = True
settings.distance_mode = "AUTO"
settings.falloff = "SQRT"
settings.scale = "PAPER"
settings.ambient = "EMISSION"
settings.reflector_mode = "NUMBER"
settings.reflectors = 0
