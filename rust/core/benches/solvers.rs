//! Times a solve of every solver along the paper's boat, side by side: rounds are interleaved, medians are printed as
//! ratios to the reference. Run with `make bench`.
#![allow(clippy::print_stdout)]

use std::time::Instant;

use oarlock_core::test_problems::{ROWS, boat};
use oarlock_core::{ConstrainedSystem, MultiplierSolver, Options, SOLVERS, Wanted, make_solver};

const ROUNDS: usize = 15;
const STEPS: usize = 2000;
const TIMESTEP: f64 = 1e-3;
const REFERENCE: &str = "pinv";

fn systems() -> Vec<ConstrainedSystem> {
    (0..STEPS)
        .map(|step| {
            let mut system = ConstrainedSystem::new();
            system.assemble(&boat(step as f64 * TIMESTEP).view()).expect("the boat is a valid system");
            system
        })
        .collect()
}

fn round(solver: &mut dyn MultiplierSolver, systems: &mut [ConstrainedSystem]) -> f64 {
    let mut x = [0.0; ROWS];
    solver.reset();
    let start = Instant::now();
    for system in systems.iter_mut() {
        system.solve(solver, Wanted::Multipliers, &mut x).expect("the boat is a valid system");
    }
    start.elapsed().as_secs_f64() * 1e9 / systems.len() as f64
}

fn main() {
    let mut systems = systems();
    let mut solvers: Vec<_> = SOLVERS
        .iter()
        .map(|kind| make_solver(kind.name, &Options::new()).expect("defaults are valid"))
        .collect();
    let mut times = vec![Vec::new(); solvers.len()];
    for _ in 0..ROUNDS {
        for (solver, times) in solvers.iter_mut().zip(&mut times) {
            times.push(round(&mut **solver, &mut systems));
        }
    }
    let medians: Vec<f64> = times
        .iter_mut()
        .map(|times| {
            times.sort_by(f64::total_cmp);
            times[times.len() / 2]
        })
        .collect();
    let reference =
        solvers.iter().position(|solver| solver.name() == REFERENCE).map_or(f64::NAN, |index| medians[index]);
    println!("boat, n = {ROWS}, {STEPS} steps, median of {ROUNDS} interleaved rounds");
    println!("{:<16} {:>12} {:>16}", "solver", "ns a solve", "ratio to pinv");
    for (solver, median) in solvers.iter().zip(&medians) {
        println!("{:<16} {median:>12.0} {:>16.2}", solver.name(), median / reference);
    }
}
