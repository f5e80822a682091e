//! The native path: oarlock's experiments as step loops over MuJoCo's own library, bit for bit as the Python path.
//!
//! # The parts, in the order that data flows
//!
//! | module | noun |
//! |---|---|
//! | [`library`] | the C library that `import mujoco` loaded, as safe types: [`Model`](library::Model), [`Data`](library::Data); all unsafe code |
//! | [`drive`], [`time_law`] | controls as laws of time |
//! | [`kinematics`], [`tendon`], [`curvature`] | J̇v of every kind of equality |
//! | [`inertia`] | rows of J through MuJoCo's sparse factor of M, and the way back to accelerations |
//! | [`inequalities`] | limits, friction loss and contacts of a state, and the forces that they answer with |
//! | [`state`] | what one state says, and the question that it puts to a solver of `oarlock-core` |
//! | [`force`] | force laws: a solver's answer, or MuJoCo's own force |
//! | [`projection`] | positions and velocities back onto the constraints |
//! | [`walker`] | MuJoCo's integrators fed with a force law |
//! | [`experiments`] | calibration, lockstep, one-step, free run, and a profile of its steps |
//! | [`stepper`] | one step on data that belong to others, in place of `mj_step`; many of them on all cores |
//! | [`run`], [`steps`] | a run on its way, and its table; many runs at once on all cores |
//! | [`vectors`] | sums in a written order |
//! | [`error`] | what ends a run |
//!
//! # Where the time goes
//!
//! A step of a free run on exact constraints (`auto`, Euler, nothing recorded; perf on one machine; `oarlock bench` measures
//! the times anew, `oarlock bench --growth` the parts against the number of loops, by [`profile`](experiments::profile)). `mj_step` of the same models takes 4.0 and
//! 15.8 µs.
//!
//! | share of a step | boat, 2.9 µs | ten four-bars with two connects each, 12.7 µs |
//! |---|---|---|
//! | MuJoCo's smooth stages and integrator | 69 % | 62 % |
//! | rows: copies, checks, folding, b, Jᵀλ | 14 % | 24 % |
//! | A and its factor | 10 % | 9 % |
//! | H Jᵀ and M⁻¹ Jᵀλ by MuJoCo's factor | 3 % | 4 % |
//! | J̇v, the drive, the loop | 4 % | 1 % |
//!
//! `mj_step` also pays for what these runs leave out: MuJoCo's timers, which its Python bindings switch on (0.7 µs a step of
//! the boat), the search for islands (0.4), and its constraint solver. What is ours is bound by passes over J rather than by
//! arithmetic: 60 rows of 21 entries are 10 kB, read for the check, the fold, b and Jᵀλ, while A of 20 folded rows takes 3 000
//! multiplications within its envelope and its factor as many.

pub mod curvature;
pub mod drive;
pub mod error;
pub mod experiments;
pub mod force;
pub mod gaps;
pub mod inequalities;
pub mod inertia;
pub mod kinematics;
pub mod library;
pub mod projection;
pub mod run;
pub mod state;
pub mod stepper;
pub mod steps;
pub mod tendon;
pub mod time_law;
pub mod vectors;
pub mod walker;

pub use error::Error;
pub use time_law::TimeLaw;
