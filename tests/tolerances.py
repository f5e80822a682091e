"""Every tolerance of the suite, by name, with what causes it. A test that needs another number adds a name here."""

# Rounding and formulas.

PAPER_FORMULA = 1e-8
"""Relative. MuJoCo wants a positive inertia along the oar where the paper has none: 1e-9 of 13 kg m² at most."""

REFERENCE_CURVATURE = 1e-9
"""Relative. J̇v recovered from aref cancels the much larger stiffness term, up to 1e4 times the rounding of aref."""

FINITE_DIFFERENCE_STEP = 1e-4
"""s. Five-point differences: truncation ~ step⁴, rounding ~ 1e-16 / step; the two meet near 1e-3, and speeds of some
/s shorten the step that a motion sees."""

FINITE_DIFFERENCE = 1e-9
"""Relative. Five-point differences with that step: 1e-12 of rounding, and truncation ~ 1e-16 times the fifth
derivatives, which a tendon of some centimetres raises to 1e-10 (measured)."""

SAME_POINT = 1e-14
"""m. Two ways to one point some metres from the origin: rounding."""

SAME_BIAS = 1e-14
"""Relative to 1 + |q̇|². The same sums in another order, on a mechanism of 1 m: 2e-16 (measured)."""

SAME_FORMULA = 1e-14
"""Relative, or m and m/rad at lengths of 1 m. One formula written twice, or an identity of it: some roundings."""

CLAIM = 1e-6
"""Relative. Figures of a script on another machine: differences of matrices 1 ms apart lose six of sixteen digits."""

CLAIM_ROUNDING = 1e-9
"""m/rad. Central differences of 1e-6 rad: rounding of 1e-16 over the step, 1.7e-10 (measured)."""

# Starts.

CLOSED = 1e-12
"""m or rad, and per s: the start's own promise, some thousand roundings of a length of 1 m."""

START_UNCHANGED = 1e-12
"""rad or m: a start that is consistent in sixteen digits is not moved beyond them."""

HELD_ERROR = 1e-9
"""rad. Runge–Kutta's own error over 0.2 s at 2 ms is 4e-11; with another control half-way 5e-7 (measured)."""

# Outside truth.

TRUTH_TABLE = 3e-11
"""Relative to the largest position or velocity. The same script on another machine: a last bit of libm in every
evaluation moves the tables by 1.2e-11 at most (spatial_slider_crank; 5e-13 where nothing magnifies it; measured)."""

TRUTH_TABLE_ACCELERATION = 1e-10
"""The same of accelerations, where the stiffest forces make 2.3e-11 of it (andrews_squeezer; measured)."""

TRUTH_OTHER_SOLVER = 1e-11
"""rad. Two integrations at 1e-13 relative of a motion of 14.7 rad, by other methods, steps or coordinates."""

TRUTH_INTERPOLATION = 1e-12
"""rad. Quintic Hermite over 2.5 ms: step⁶/46080 of the sixth derivative, ~1e-13 here (measured)."""

HERMITE = 1e-14
"""Relative to the largest value or term. One quintic from the same ends, summed in another order: 5e-16 (measured)."""

# Parity with MuJoCo.

CALIBRATION = 1e-12
"""rad or m. MuJoCo's own force through our stepping, 2000 steps: rounding, 7e-15 on the boat (measured)."""

CALIBRATION_SWINGING = 1e-10
"""rad or m. The same for a mechanism that falls through its dead points: they magnify rounding a thousandfold, and
where it comes to rest MuJoCo's Newton stops within its tolerance, at a place that hangs on the last bit (1e-11)."""

NEWTON_TIGHT = 1e-10
"""MuJoCo's ``tolerance`` at which its Newton no longer stops before its first iteration in a pose that is nearly
singular; its default is 1e-8."""

CALIBRATION_BROKEN = 1e-7
"""rad or m. What a stepping that leaves out a part of the force must exceed: far above both."""

LOCKSTEP_PARITY = 1e-9
"""Relative. The same linear system solved elsewhere: rounding times its condition (6e-14 measured on the boat)."""

NEWTON_STOPS = 1e-7
"""Relative. Where a warm start is within MuJoCo's own tolerance of 1e-8, its Newton leaves it as it is: 1.6e-8 measured
on a falling hopper, and 2e-14 with its tolerance at 0."""

SOFTNESS_SHOWS = 1e-2
"""Relative. What MuJoCo's default softness must at least make of acceleration and force: 1.9 and 0.12 on the boat."""

FREE_PARITY = 1e-10
"""rad or m. ``LOCKSTEP_PARITY`` accumulated over a second of a stable motion (1e-15 measured on the boat)."""

SAME_ACCELERATION = 1e-9
"""Relative. Two factorisations of one singular system: rounding times the condition on its range."""

SR1_ACCELERATION = 1e-6
"""Relative. Two answers of sr1 that both meet its own stopping test, ‖r‖ ≤ eps_abs = 1e-6."""

# What the discretisation leaves.

HARD_DRIFT = 1e-9
"""m. Runge–Kutta's own error at 1 ms, held by Baumgarte: 2.4e-10 measured on the boat."""

EXACT_DRIFT = 1e-8
"""m or rad. What an exact run may be open by: rounding, but for gears of 1e5, whose rows count it 1e5 times."""

ENERGY_DRIFT = 1e-5
"""Relative to the kinetic energy. Runge–Kutta and the drift of an unstabilised loop over a second at 2 ms."""

MOMENTUM_DRIFT = 5e-9
"""kg m/s, kg m²/s. Runge–Kutta's own error at 1 ms over 0.3 s: 1.1e-9 measured, sixteen times that at 2 ms."""

OPEN_LOOP_TORQUE = 1e-7
"""kg m²/s. What the forces of a soft loop must at least make of angular momentum, at points that stand apart: 3e-6."""

RK4_ORDER_LOW, RK4_ORDER_HIGH = 12.0, 20.0
"""Ratio of the truth error when the timestep is halved: 2⁴ = 16, with the next order's share at finite steps."""

EULER_ORDER_LOW, EULER_ORDER_HIGH = 1.8, 2.2
"""The same of Euler: 2."""

SOFTNESS_ALONE = 1e-2
"""Relative. How far MuJoCo's drift hangs on the timestep where its softness makes it: 7e-4 at most (measured)."""

FROZEN_DRIVE = 1e-7
"""rad. What a drive that is held over a Runge–Kutta step must at least spoil within 0.2 s."""

CURVATURE_SHOWS = 0.03
"""Relative. A stiff row's deviation against J̇v/(K d), its rest without inertia: it lags by two time constants of 4 ms
behind a J̇v that changes over 0.2 s and more, and its force adds the softness of 1e-4 (0.0005 and 0.007 measured)."""

CURVATURE_RESTORED = 0.02
"""Of the deviation. What is left once J̇v is in the question: 1e-4 of softness, 0.001 and 0.007 measured."""

GEAR_TORQUE = 1e-10
"""Of the torque. Rounding times the condition of A, and the rounding of two mirrored fingers: 1e-12 measured."""

# Projection.

PROJECTED = 1e-14
"""m or rad, and per s. Two roundings of a model of 8 m, where the projection stops: 3.6e-15 on the boat (measured)."""

M_ORTHOGONAL = 1e-9
"""Relative. The first solve of sr1-tracked is an eigendecomposition: rounding times the condition of A on its range."""

NEARLY_REDUNDANT = 1e-3
"""Relative singular value of J. A redundant row that is 1e-4 m open gets about 1e-4, the smallest true one is 0.3."""

STRAIGHT_WAY = 1e-9
"""rad. What rounding, magnified by a nearly singular pose, may put between two parallel bars: 2e-13 measured."""

SINGULAR_ENERGY = 1e-8
"""Relative. Runge–Kutta at 2 ms over three seconds of a parallelogram: 6e-11 (measured)."""

SINGULAR_ENERGY_LOST = 1e-6
"""Relative. What Baumgarte's terms at least make of it: 7e-4 (pinv) and 0.27 (sr1-tracked) measured, and how much hangs
on the last bit."""

# The method.

MIN_NORM_LOW, MIN_NORM_HIGH = 1.7, 2.0
"""‖λ − A⁺b‖/‖A⁺b‖ of sr1 on the boat: tan 60° = 1.732 by theory, approached at the end of the stroke."""

ITERATIONS_BAND = 0.05
"""The paper prints 1.994 and neither its integrator nor its tolerance."""

SOLVE_RESIDUAL = 1e-10
"""Relative. Pseudo-inverse of matrices whose positive eigenvalues span three decades: rounding times 1e3, with room."""

# Reactions.

DETERMINED_REACTION = 1e-8
"""Relative to the largest multiplier. Two pseudo-inverses of one problem: rounding times A's condition, below 1e8."""

ARBITRARY_REACTION = 1e-3
"""As above. What weights between ½ and 2 must at least move a multiplier that is not determined: tenths, mostly."""

# Why loops drift.

POWER_BALANCE = 1e-5
"""J. Less work of the loops than that would be no test of where energy went."""

WORK_OF_ROWS = 5e-3
"""Relative. Works by the trapezoidal rule at 1 ms, of powers that change within 10 ms (1e-3 measured, at most)."""

WORK_OF_IMPACTS = 0.03
"""Of the energy that contacts and friction took: powers that jump at an impact, at 0.2 ms (0.012 measured)."""

PARTS_SUM = 1e-15
"""m or rad. The parts of a row's deviation: the last of them is what the others leave, and only rounding is lost."""

OSCILLATOR = 1e-13
"""Relative. Two exponentials of one matrix, by squarings of another series."""

HALF_A_TIMESTEP = 0.05
"""Relative. Euler's own error at half a timestep is half of it, but for the next order's share (0.006 measured)."""

SAME_PART = 0.01
"""Relative. What another softness makes of the motion, and so of J̇v, in 0.3 s (9e-4 measured)."""

ACCELERATION_PARTS = 1e-7
"""Relative. Two ways through the same rows, one over the pseudo-inverse of A, whose condition is the square of J's."""

REDUNDANT_PARTS = 1e-3
"""Relative. The same where rows are redundant and open by 1e-4 m: their differences then move the mechanism by about
1e-4 of what they are, and that is in MuJoCo's acceleration and in no part (9e-5 measured)."""

SAME_RUN = 1e-12
"""Relative. Of a run of MuJoCo that is made twice, here and by plain steps: its bits are the same, and a figure of
it is rounded once."""

SAME_SETTINGS = 1e-12
"""Relative. One formula of some products and powers, in two places."""

# A run's own error.

ESTIMATE_FACTOR = 10.0
"""Between a run's own estimate and its distance from an outside truth; most agree to a hundredth (measured)."""

ESTIMATE_ROUNDING = 2e-12
"""rad or m. Rounding of thousands of steps, and of a truth that is interpolated."""

ESTIMATE_SHARP = 0.25
"""Relative. What the next order adds to Richardson's estimate at 2 ms, and what is left of the finer run's error."""

# Ends.

SOON_S = 2.0
"""s. What an interruption may take to end a command, on a busy machine: a look at most every 0.2 s, then the end."""

GONE_S = 5.0
"""s. What workers may take to end after their parent did: they look every 0.5 s, and on Linux are told at once."""

# Inequality rows.

WHOLE_ANSWER = 1e-8
"""Relative to the largest entry. Accelerations and forces beside forty digits: ε times the condition of M, 1e4, and
times a stiffness of 1e3 to 1e5 beside the inertia."""

MATCHED_FORCE = 1e-9
"""Relative. Constraint forces of a gripper beside MuJoCo's at tolerance 0: 4e-14 (measured); asked of all models."""

MATCHED_ACCELERATION = 1e-8
"""Relative to the largest entry, or rad/s². The same accelerations: 2e-12 (measured)."""

SOLVED_BY_MUJOCO = 1e-12
"""Relative. Gradient of an answer of MuJoCo's at rounding: its own stiffness, 1e4, times ε."""

# Mocap bodies that move.

DIFFERENCED_RATE = 1e-10
"""m/s or rad/s, or relative. ∂r/∂t from five poses 1 ms apart: 1e-16 of rounding over that, 2e-11 for a weld that turns
(measured)."""

UNPROJECTED_SECOND = 1e-9
"""m or rad. r̈ from such differences, 1e-9 m/s² off at random, integrated for a second, and Runge–Kutta's own error at
2 ms: 2e-11 (measured); a term left out makes 1e-2."""

SAME_MOTION = 1e-8
"""m or rad. Runge–Kutta's own error at 2 ms over half a second, of two ways to one motion."""

BODY_FORCE = 1e-7
"""N. 0.8 kg times what differences leave of an acceleration, 1e-9 m/s², and of its sixth derivative."""

HALF_OF_A_STEP = 1e-3
"""m or rad. A log goes straight between its rows, 2 ms apart: h²/8 of 4 m/s² is 2e-6, and its velocities are half a
step late, which moves what hangs freely below the tray."""

# Nearest poses.

NEAREST_POSE = 1e-9
"""rad or m. One minimum, closed again to 1e-12 by steps in the metric of M."""

# Other engines.

SAME_LAW = 1e-9
"""Relative. MuJoCo's own solver and ours on one problem, to its tolerance of 1e-15: rounding of R, 1e-4 of A (measured
2e-15 without contacts, 1e-11 with)."""

HAND_SOLVED = 1e-4
"""Relative to the acceleration. Differences of J over 1 µs: rounding of 1e-16 over the step, 1e-10, and of the pose."""

AT_REST = 1e-12
"""Relative. The same equations in the same precision, compiled by others: rounding, magnified by D = 1/R (measured
1e-13)."""
