"""What a pose owes to what it is made of: `systematic`, how the errors of a rig and of a handle's
layout reach the pixels and the pose; `usual`, what is taken for those that state nothing; `size`, how
large the errors are by what is seen; `centroids`, the bias that the centroids of wrapped markers have
in common.
"""
