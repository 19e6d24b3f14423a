import bpy

settings = bpy.context.scene.obscurance

settings.rays = 16
settings.ray_budget = 0
settings.sampler = "SOBOL"
settings.ambient = "RECEIVED"
settings.reflector_mode = "AUTO"
