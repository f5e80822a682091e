"""What the help of every command ends with: a line that can be typed as it stands."""

EXAMPLES = {
    "list": "oarlock list --json",
    "run": "oarlock run boat --mode free --duration 2 --report page",
    "new": "oarlock new my_linkage path/to/model.xml",
    "report": "oarlock report results/boat",
    "figure": "oarlock figure results/boat --width 86mm",
    "bench": "oarlock bench --size 24 --rounds 3",
    "suite": "oarlock suite four_bar --sweep timestep=5e-4:4e-3:4",
    "check": "oarlock check gripper.xml leg.xml --fail-above 1e-4 --sarif loops.sarif",
    "close": "oarlock close arm.urdf --pair tip_left tip_right -o closed.xml",
    "view": "oarlock view boat --duration 2 -o boat.html",
    "diff": "oarlock diff results/boat elsewhere/boat --junit diff.xml",
    "conform": "oarlock conform four_bar stewart --engine mujoco@3.6 --engine mjx --install",
    "versions": "oarlock versions four_bar stewart --mujoco 3.3.7,3.6,3.7,4.0 --install",
    "sample": "oarlock sample four_bar -n 100 -o poses.npz",
    "export": "oarlock export four_bar --for pinocchio -o four_bar_pinocchio.xml",
    "explain": "oarlock explain D1",
    "solvers": "oarlock solvers --json",
    "export-problems": "oarlock export-problems boat --duration 0.1 -o boat.npz",
}
"""Name of a command → an example."""
