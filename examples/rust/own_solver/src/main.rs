//! Walks the paper's rowing boat with a solver of one's own, and holds every step against the pseudo-inverse.
//!
//! ```sh
//! cargo run --release --manifest-path examples/rust/own_solver/Cargo.toml
//! ```

use oarlock_core::params::Params;
use oarlock_core::solvers::Solver;
use oarlock_core::test_problems::{NV, ROWS, boat};
use oarlock_core::{ConstrainedSystem, Error, Options, Wanted, make_solver};
use own_solver::{Sor, SorParams};

const TIMESTEP: f64 = 1e-3;
const STEPS: u32 = 1000;

fn main() -> Result<(), Error> {
    let mut mine = Sor::new(SorParams::from_options(&Options::new())?);
    let mut reference = make_solver("pinv", &Options::new())?;
    let (mut system, mut x, mut least) = (ConstrainedSystem::new(), [0.0; ROWS], [0.0; ROWS]);
    let (mut iterations, mut converged, mut gap) = (0, 0, 0.0_f64);
    for step in 1..=STEPS {
        system.assemble(&boat(TIMESTEP * f64::from(step)).view())?;
        let info = system.solve(&mut mine, Wanted::Acceleration, &mut x)?;
        system.solve(&mut *reference, Wanted::Multipliers, &mut least)?;
        iterations += info.iterations;
        converged += u32::from(info.status.name() == "converged");
        gap = gap.max(distance(&mut system, &x, &least)?);
    }
    println!(
        "{converged} of {STEPS} solves converged, in {:.1} sweeps on average",
        iterations as f64 / f64::from(STEPS)
    );
    println!("largest difference of an acceleration, relative: {gap:.1e}");
    Ok(())
}

/// How far the accelerations of two sets of multipliers differ, of the largest entry.
fn distance(system: &mut ConstrainedSystem, x: &[f64], y: &[f64]) -> Result<f64, Error> {
    let (mut force, mut a, mut b) = ([0.0; NV], [0.0; NV], [0.0; NV]);
    system.acceleration(x, &mut force, &mut a)?;
    system.acceleration(y, &mut force, &mut b)?;
    let largest = b.iter().fold(0.0_f64, |most, value| most.max(value.abs()));
    Ok(a.iter().zip(&b).fold(0.0_f64, |most, (a, b)| most.max((a - b).abs())) / largest)
}
