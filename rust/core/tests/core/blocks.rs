//! Blocks of rows, constraints of very different size, ranks that are held, and solvers that are held to their word.

use crate::support::solver;
use oarlock_core::make_solver;
use oarlock_core::problem::Needs;
use oarlock_core::{
    ConstrainedSystem, Error, Info, MultiplierSolver, Options, Problem, SOLVERS, State, Status, StepView,
    Wanted,
};

/// Accelerations of every solver, and the rank that those who know one say.
fn accelerations(
    step: &StepView<'_>,
    prepare: impl Fn(&mut ConstrainedSystem),
) -> Vec<(&'static str, Vec<f64>, Info)> {
    let (n, nv) = step.shape();
    SOLVERS
        .iter()
        .map(|kind| {
            let mut system = ConstrainedSystem::new();
            prepare(&mut system);
            system.assemble(step).expect("good input");
            let mut solver = make_solver(kind.name, &Options::new()).expect("defaults");
            let (mut x, mut qfrc, mut qacc) = (vec![0.0; n], vec![0.0; nv], vec![0.0; nv]);
            let info = system.solve(&mut *solver, Wanted::Multipliers, &mut x).expect("good input");
            system.acceleration(&x, &mut qfrc, &mut qacc).expect("finite");
            (kind.name, qacc, info)
        })
        .collect()
}

/// Every acceleration that converged is this one, those of direct solvers have, and every rank is this.
#[track_caller]
fn assert_all(found: &[(&'static str, Vec<f64>, Info)], right: &[f64], rank: usize) {
    let scale = right.iter().fold(0.0_f64, |scale, entry| scale.max(entry.abs()));
    for (name, qacc, info) in found {
        if info.status == Status::Converged {
            for (got, right) in qacc.iter().zip(right) {
                assert!((got - right).abs() <= 1e-6 * scale, "{name}: {qacc:?}, not {right:?}, {info:?}");
            }
            if *name != "cholesky" {
                assert!(info.rank.is_none_or(|found| found == rank), "{name}: {info:?}");
            }
        }
        assert!(
            info.status == Status::Converged || !["auto", "pinv", "svd"].contains(name),
            "{name}: {info:?}"
        );
    }
}

/// Two masses of 10 kg held together by two rows that say the same, turned by 60° to one another so that folding does not see it;
/// beside them a screw and its nut of 50 g, and a row of 12 566 rad a metre.
const SCREW: [f64; 20] = [
    1.0, 0.0, 0.0, 0.0, 0.0, //
    0.5, 0.5, 0.0, 0.0, 0.0, //
    0.0, 1.0, 0.0, 0.0, 0.0, //
    0.0, 0.0, 0.0, 1.0, -12_566.0,
];

#[test]
fn a_light_block_does_not_lose_its_rows_beside_a_heavy_one() {
    let mut mass = [0.0; 25];
    for (i, entry) in [1e3, 1e3, 1.0, 1e-6, 0.05].into_iter().enumerate() {
        mass[6 * i] = entry;
    }
    let step = StepView {
        mass: &mass,
        jacobian: &SCREW,
        force: &[1e3, 2e3, 1.0, 0.0, -0.5],
        aref: &[3.0, 3.5, 4.0, 0.0],
        regularisation: None,
    };
    // The nut drags a screw of 1e-6 · 12566² kg along.
    let nut = -0.5 / (0.05 + 1e-6 * 12_566.0_f64.powi(2));
    let right = [3.0, 4.0, 1.0, 12_566.0 * nut, nut];
    let found = accelerations(&step, |_| {});
    assert_all(&found, &right, 3);
    assert!(found.iter().filter(|(_, _, info)| info.status == Status::Converged).count() >= 8, "{found:?}");
}

#[test]
fn a_gear_in_a_loop_does_not_hide_the_rows_of_the_loop_once_constraints_are_known() {
    // A rotor of 1e-8 kg m² behind a gear of 1e5 turns the first of two masses, which a connect holds together.
    let mut mass = [0.0; 9];
    for (i, entry) in [1e-8, 1e3, 1e3].into_iter().enumerate() {
        mass[4 * i] = entry;
    }
    let jacobian = [1.0, -1e5, 0.0, 0.0, 1.0, -1.0, 0.0, 0.6, -0.6];
    let step = StepView {
        mass: &mass,
        jacobian: &jacobian,
        force: &[0.0, 200.0, 400.0],
        aref: &[0.0; 3],
        regularisation: None,
    };
    let heavy = 600.0 / (2e3 + 1e-8 * 1e10);
    let found = accelerations(&step, |system| system.set_constraints([0, 1, 1].into_iter()));
    assert_all(&found, &[1e5 * heavy, heavy, heavy], 2);
}

/// A bar on two parallel rods that stand open by `gap` rad: a third row that is redundant where they are closed.
fn open(gap: f64) -> [f64; 9] {
    [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, gap.cos(), 1.0, gap.sin()]
}

#[test]
fn a_rank_is_held_by_every_solver_while_rows_stand_open() {
    let mass = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
    for kind in SOLVERS {
        let mut solver = make_solver(kind.name, &Options::new()).expect("defaults");
        let mut system = ConstrainedSystem::new();
        let mut solve = |gap: f64, held: bool| {
            if held {
                system.hold_rank(&[gap; 3]);
            }
            let step = StepView {
                mass: &mass,
                jacobian: &open(gap),
                force: &[0.0, 0.0, 1.0],
                aref: &[1.0, 1.0, 2.0],
                regularisation: None,
            };
            system.assemble(&step).expect("good input");
            let (mut x, mut qfrc, mut qacc) = ([0.0; 3], [0.0; 3], [0.0; 3]);
            let info = system.solve(&mut *solver, Wanted::Multipliers, &mut x).expect("good input");
            system.acceleration(&x, &mut qfrc, &mut qacc).expect("finite");
            (qacc[2], info)
        };
        let (free, info) = solve(0.0, true);
        assert_eq!((info.status, info.rank.unwrap_or(2)), (Status::Converged, 2), "{}", kind.name);
        assert!((free - 1.0).abs() < 1e-9, "{}: nothing holds it: {free}", kind.name);
        for gap in [1e-4, 2e-4, 1e-3, 2e-3] {
            let (free, info) = solve(gap, true);
            if info.status == Status::Converged {
                assert!((free - 1.0).abs() < 1e-2, "{} at {gap:e}: {free}, {info:?}", kind.name);
                assert_eq!(info.rank.unwrap_or(2), 2, "{} at {gap:e}", kind.name);
            }
            assert!(
                info.status == Status::Converged || kind.name.starts_with("cholesky-") || info.rank.is_none()
            );
        }
        // Who does not say how open the rows are gets what the numbers say.
        let (stopped, info) = solve(1e-3, false);
        assert!(
            info.status != Status::Converged || stopped.abs() < 1e-3,
            "{}: {stopped}, {info:?}",
            kind.name
        );
    }
}

/// Claims to have solved what it has not.
struct Boaster;

impl MultiplierSolver for Boaster {
    fn name(&self) -> &'static str {
        "boaster"
    }
    fn needs(&self) -> Needs {
        Needs::Operator
    }
    fn rank_cut(&self) -> Option<f64> {
        None
    }
    fn is_direct(&self) -> bool {
        false
    }
    fn solve(&mut self, problem: &mut Problem<'_>, x: &mut [f64]) -> Result<Info, Error> {
        x.copy_from_slice(problem.rhs());
        Ok(Info::trivial(0.0))
    }
    fn reset(&mut self) {}
    fn clone_box(&self) -> Box<dyn MultiplierSolver> {
        Box::new(Self)
    }
    fn state(&self) -> State {
        State::new("boaster", 0)
    }
    fn restore(&mut self, _: &State) -> Result<(), Error> {
        Ok(())
    }
}

#[test]
fn a_solver_is_held_to_its_word_in_every_block() {
    let mut system = ConstrainedSystem::new();
    let mut asked = |matrix: &[f64]| {
        system.set_dense(matrix, &[1e6, 1.0]).expect("good input");
        let mut x = [0.0; 2];
        let told =
            system.solve_unchecked(&mut Boaster, Wanted::Multipliers, &mut x).expect("good input").status;
        let held = system.solve(&mut Boaster, Wanted::Multipliers, &mut x).expect("good input").status;
        (told, held)
    };
    assert_eq!(
        asked(&[1.0, 0.0, 0.0, 1.0]),
        (Status::Converged, Status::Converged),
        "it happens to be right"
    );
    // The second block is wrong by half, a millionth of the first.
    assert_eq!(asked(&[1.0, 0.0, 0.0, 2.0]), (Status::Converged, Status::Inaccurate));
    assert_eq!(Status::Inaccurate.name(), "inaccurate");
}

#[test]
fn nobody_is_his_own_judge() {
    let mut system = ConstrainedSystem::new();
    system.set_dense(&[2.0, 1.0, 1.0, 2.0], &[3.0, 3.0]).expect("good input");
    for kind in SOLVERS {
        let (multipliers, info) = system.reference(&*solver(kind.name)).expect("good input");
        assert!(
            multipliers.iter().all(|entry| (entry - 1.0).abs() < 1e-14),
            "{}: {multipliers:?}",
            kind.name
        );
        assert_eq!((info.rank, info.status), (Some(2), Status::Converged), "{}", kind.name);
    }
}

#[test]
fn tiny_systems_have_answers_and_not_zeros() {
    for (a, b) in [(1.0, 1e-170), (1e-170, 1.0), (1e-200, 1e-200), (1e-280, 1e-250)] {
        for kind in SOLVERS {
            let mut system = ConstrainedSystem::new();
            system.set_dense(&[2.0 * a, a, a, 2.0 * a], &[b, -b]).expect("good input");
            let mut x = [0.0; 2];
            let info =
                system.solve(&mut *solver(kind.name), Wanted::Multipliers, &mut x).expect("good input");
            let right = b / a;
            let gap = (x[0] - right).abs().max((x[1] + right).abs());
            assert!(
                info.status == Status::Converged && gap <= 1e-6 * right,
                "{} A {a:e} b {b:e}: {x:?}, {info:?}",
                kind.name
            );
        }
    }
}

#[test]
fn the_margin_says_how_near_to_the_cut_an_eigenvalue_lies() {
    for (least, margin) in [(1e-8, 100.0), (1e-12, 100.0), (1e-2, 1e8)] {
        for name in ["pinv", "svd"] {
            let mut system = ConstrainedSystem::new();
            // Eigenvalues 1 and `least` of one block.
            let (sum, half) = (0.5 * (1.0 + least), 0.5 * (1.0 - least));
            system.set_dense(&[sum, half, half, sum], &[1.0, 1.0]).expect("good input");
            let info =
                system.solve(&mut *solver(name), Wanted::Multipliers, &mut [0.0; 2]).expect("good input");
            let found = info.margin.expect("it has eigenvalues");
            assert!((found / margin - 1.0).abs() < 1e-3, "{name} at {least:e}: {found}");
        }
    }
}
