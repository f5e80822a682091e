//! What holds of the solver: it is right along a walk, what it saves restores it, and a wrong option is refused.

use oarlock_core::params::Params;
use oarlock_core::solvers::Solver;
use oarlock_core::test_problems::{NV, ROWS, boat};
use oarlock_core::{ConstrainedSystem, Options, Status, Wanted, make_solver};
use own_solver::{Sor, SorParams};

/// Relative, of an acceleration: the solver's own tolerance 1e-10 times the condition of the boat's A, below 100.
const CLOSE: f64 = 1e-8;

fn solver() -> Sor {
    Sor::new(SorParams::from_options(&Options::new()).unwrap())
}

#[test]
fn accelerations_are_those_of_the_pseudo_inverse() {
    let (mut mine, mut reference) = (solver(), make_solver("pinv", &Options::new()).unwrap());
    let (mut system, mut x, mut force) = (ConstrainedSystem::new(), [0.0; ROWS], [0.0; NV]);
    for step in 1..=100 {
        system.assemble(&boat(1e-2 * f64::from(step)).view()).unwrap();
        let [mut ours, mut right] = [[0.0; NV]; 2];
        let info = system.solve(&mut mine, Wanted::Acceleration, &mut x).unwrap();
        assert_eq!(info.status, Status::Converged);
        system.acceleration(&x, &mut force, &mut ours).unwrap();
        system.solve(&mut *reference, Wanted::Multipliers, &mut x).unwrap();
        system.acceleration(&x, &mut force, &mut right).unwrap();
        let largest = right.iter().fold(0.0_f64, |most, value| most.max(value.abs()));
        let gap = ours.iter().zip(&right).fold(0.0_f64, |most, (a, b)| most.max((a - b).abs()));
        assert!(gap <= CLOSE * largest, "step {step}: {gap:e} of {largest:e}");
    }
}

#[test]
fn a_restored_solver_goes_on_to_the_last_bit() {
    let (mut first, mut system) = (solver(), ConstrainedSystem::new());
    let [mut x, mut y] = [[0.0; ROWS]; 2];
    system.assemble(&boat(0.1).view()).unwrap();
    system.solve(&mut first, Wanted::Acceleration, &mut x).unwrap();
    let mut second = solver();
    Solver::restore(&mut second, &Solver::state(&first)).unwrap();
    system.assemble(&boat(0.101).view()).unwrap();
    system.solve(&mut first, Wanted::Acceleration, &mut x).unwrap();
    system.solve(&mut second, Wanted::Acceleration, &mut y).unwrap();
    assert_eq!(x, y);
}

#[test]
fn a_wrong_option_is_refused_by_its_name() {
    let told = SorParams::from_options(&Options::new().with("omega", 1.2)).unwrap_err().to_string();
    assert!(told.contains("omega") && told.contains("half_omega"), "{told}");
    assert!(SorParams::from_options(&Options::new().with("half_omega", 1.0)).is_err());
}
