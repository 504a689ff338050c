"""The configuration NLP: multiple shooting over curvature segments in a corridor (sections 3 and 4.1 as one program).

The modules load CasADi; import them where they are needed, not at the top of light modules.
"""
