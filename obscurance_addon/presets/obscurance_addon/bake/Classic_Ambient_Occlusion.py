import bpy

settings = bpy.context.scene.obscurance

settings.use_bleeding = False
settings.falloff = "STEP"
settings.scale = "WHITE"
settings.ambient = "RECEIVED"
settings.reflector_mode = "AUTO"
