//! One state of a redundant four-bar, from M, J and the bias forces: forces in its pins and accelerations.
//!
//! ```sh
//! cargo run -p oarlock-core --example four_bar
//! ```
//!
//! Two cranks of 1 m and 1 kg on the pivots (0, 0) and (1, 0), at θ from the vertical, and a coupler of 1 m and 1 kg between
//! their tops. q = (θ₀, θ₁, φ), φ the coupler's angle from the horizontal. A planar model closes its loop by one pin,
//! two rows; a model in space by two pins on the axis, at ±z, three rows each: six rows, of which four say nothing new.
#![allow(clippy::print_stdout)]

use oarlock_core::{ConstrainedSystem, Error, Options, StepView, Wanted, make_solver};

const GRAVITY: f64 = 9.81;

fn main() -> Result<(), Error> {
    let (theta, speed) = (0.5_f64, 1.0);
    let (sin, cos) = theta.sin_cos();

    // M a + bias = Jᵀ λ, on the branch θ₀ = θ₁ = θ, φ = 0: crank 0 carries the coupler.
    #[rustfmt::skip]
    let mass = [
        4.0 / 3.0,  0.0,        -0.5 * sin,
        0.0,        1.0 / 3.0,  0.0,
        -0.5 * sin, 0.0,        1.0 / 3.0,
    ];
    let bias = [-1.5 * GRAVITY * sin, -0.5 * GRAVITY * sin, 0.5 * (GRAVITY - speed * speed * cos)];
    #[rustfmt::skip]
    let pin = [
        cos,  -cos, 0.0, // x: top of crank 0 plus coupler minus top of crank 1
        -sin, sin,  1.0, // y
        0.0,  0.0,  0.0, // z
    ];
    let jacobian = [pin, pin].concat();
    // Both tops run on circles of the same radius at the same speed: −J̇v is zero.
    let aref = [0.0; 6];

    let step = StepView {
        mass: &mass,
        jacobian: &jacobian,
        force: &bias.map(|bias| -bias),
        aref: &aref,
        regularisation: None,
    };
    let mut system = ConstrainedSystem::new();
    system.assemble(&step)?;
    let mut solver = make_solver("auto", &Options::new())?;
    let (mut multipliers, mut force, mut acceleration) = ([0.0; 6], [0.0; 3], [0.0; 3]);
    let info = system.solve(&mut *solver, Wanted::Multipliers, &mut multipliers)?;
    system.acceleration(&multipliers, &mut force, &mut acceleration)?;

    println!("rows {}, taken out by folding {}, rank of the rest {:?}", aref.len(), info.folded, info.rank);
    println!("forces in the pins, N    {multipliers:.4?}");
    println!("generalised forces, N m  {force:.4?}");
    println!("accelerations, rad/s²    {acceleration:.4?}");
    // All of it is one pendulum: θ̈ = k sin θ with k = 2 g / (5/3).
    println!("in closed form           {:.4}", 1.2 * GRAVITY * sin);
    Ok(())
}
