"""Worlds: objects that people hold together, one module for each method of stepping; `cogrip.server.schemes` chooses.

Symbols in all of them: n users, a axes; T frame [s]; b impedance, B damping [N s/m]; K stiffness [N/m]; m_o, b_o object's
mass [kg] and damping [N s/m]; x_o, v_o its position [m] and velocity [m/s], shape (a,); e stretch x_s - x_o [m] and
F force of the user on the object [N], shape (n, a); u, v waves [sqrt(W)], shape (n, a); c = sqrt(2/b), shape (n, 1).
"""
