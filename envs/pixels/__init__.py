"""Images of many simulations: by rays, which need no graphics at all, or by OpenGL.

`envs.pixels.renderers.make_renderer("rays" | "gl", simulation, size)` chooses;
`envs.pixels.env.PixelsEnv` is the TorchRL environment that adds images to its observations.
"""
