"""The electrode array: a discrete elastic rod in the plane of insertion, in frictional contact (08 section 3).

state      the record: parameters, nodes, memory of the material
stylet     what the stylet makes of stiffness and rest curvature, and what stays bent
elastic    stretching, bending and damping: gradient and band matrix of the step's energy
contact    walls, lips, face, recess and the array itself; with friction
band       the linear solve, from the tip to the gripper
step       one tick: predictor, Newton, sub-steps; the wrench on the gripper
events     fold, buckle and contacts, as truth
"""
