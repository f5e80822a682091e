//! The experiments: calibration, lockstep, one-step, free run. The same as `oarlock.python_path`, figure for figure; and a
//! profile of the free run's steps.

mod calibration;
mod common;
mod free;
mod lockstep;
mod one_step;
mod profile;

pub use calibration::calibration;
pub use free::{bare, free_mujoco, free_solved};
pub use lockstep::{Asked, lockstep};
use oarlock_core::MultiplierSolver;
pub use one_step::one_step;
pub use profile::{Part, Profile, Spent, profile};

/// A solver of its own.
pub type Solver = Box<dyn MultiplierSolver>;

#[cfg(all(test, unix))]
mod tests {
    use oarlock_core::{Options, make_solver};

    use super::*;
    use crate::library::testing::model;
    use crate::run::{Run, Setup};
    use crate::state::{Baumgarte, Form};
    use crate::steps::Column;

    /// Two bobs of 1 kg on arms of 1 m that are one pendulum: the second connect says what the first one does.
    const PENDULUM: &str = r#"<mujoco>
      <option timestep="1e-3" integrator="RK4"><flag contact="disable" energy="enable"/></option>
      <worldbody>
        <body name="one"><joint type="hinge" axis="0 1 0"/><geom size=".1" mass="1" pos="0 0 -1"/></body>
        <body name="two"><joint type="hinge" axis="0 1 0"/><geom size=".1" mass="1" pos="0 0 -1"/></body>
      </worldbody>
      <equality>
        <connect body1="one" body2="two" anchor="0 0 -1"/><connect body1="one" body2="two" anchor="0 0 -.5"/>
      </equality>
    </mujoco>"#;

    fn setup() -> Setup {
        Setup {
            model: model(PENDULUM),
            drive: crate::drive::Drive::default(),
            qpos: vec![1.0; 2],
            qvel: vec![0.0; 2],
            act: Vec::new(),
            baumgarte: Baumgarte::default(),
            observed: None,
            conserved: true,
            inequalities: false,
            snapshots: vec![3],
        }
    }

    fn solver(name: &str) -> Solver {
        make_solver(name, &Options::new()).expect(name)
    }

    fn floats(run: &mut Run, wanted: &str) -> Vec<f64> {
        let table = run.take_tables().remove(0);
        match table.into_iter().find(|(name, _)| *name == wanted) {
            Some((_, Column::Float { values, .. })) => values,
            other => panic!("{wanted}: {other:?}"),
        }
    }

    #[test]
    fn a_solver_that_walks_alone_keeps_the_energy_of_a_pendulum() {
        let mut run =
            free_solved(&setup(), Form::Hard, solver("sr1-tracked"), None, None, true, 1000).expect("a setup");
        assert_eq!((run.advance(1000), run.end()), (1000, None));
        let kept = run.take_snapshots();
        assert_eq!((kept.len(), kept[0].step, kept[0].multipliers.len()), (1, 3, 6));
        let energy = floats(&mut run, "energy");
        let gone = energy.iter().map(|now| (now - energy[0]).abs()).fold(0.0, f64::max);
        // 10 J, and an integrator of order four at 1 ms.
        assert!(gone < 1e-9, "{gone:e} J");
    }

    #[test]
    fn all_solvers_give_the_least_multipliers_along_the_walk_of_mujoco() {
        let named = |name| solver(name);
        let asked = vec![(Form::Hard, ["auto", "sr1-tracked", "pinv-tracked"].map(named).into())];
        let mut run = lockstep(&setup(), None, asked, 50).expect("a setup");
        assert_eq!((run.advance(50), run.end()), (50, None));
        for table in run.take_tables().into_iter().skip(1) {
            let errors = table.into_iter().find(|(name, _)| *name == "min_norm_error");
            let Some((_, Column::Float { values, .. })) = errors else { continue };
            assert!(values.iter().all(|error| *error < 1e-7), "{values:?}");
        }
    }

    #[test]
    fn mujocos_own_force_through_our_stepping_walks_as_mujoco_does() {
        let mut run = calibration(&setup(), 200).expect("a setup");
        assert_eq!((run.advance(200), run.end()), (200, None));
        let apart = floats(&mut run, "trajectory_diff");
        assert!(apart.iter().all(|apart| *apart < 1e-12), "{apart:?}");
    }
}
