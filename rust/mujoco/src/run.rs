//! A run: one walk, with a table for everyone who answers along it. Rows are written at the start of every step, where state,
//! question and answer belong together.

use std::sync::Arc;
use std::time::Instant;

use rayon::prelude::*;

use crate::drive::Drive;
use crate::error::Error;
use crate::library::{Data, Model, without_timers};
use crate::projection::contradiction;
use crate::state::{Baumgarte, State};
use crate::steps::{Column, Steps};
use crate::vectors::largest;
use crate::walker::{bounded, is_sane};

/// What an outside truth speaks of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Observed {
    /// An entry of qpos.
    Coordinate(usize),
    /// The place of a site.
    Site(usize),
}

impl Observed {
    /// Where it is, at a state whose position stage is done: rad or m.
    pub(crate) fn place(self, data: &Data) -> &[f64] {
        match self {
            Self::Coordinate(index) => &data.qpos()[index..=index],
            Self::Site(index) => &data.site_xpos()[3 * index..3 * index + 3],
        }
    }
}

/// What a run starts from and what is written down of it besides what it is for.
#[derive(Clone)]
pub struct Setup {
    /// The model, prepared.
    pub model: Arc<Model>,
    /// Its drive.
    pub drive: Drive,
    /// A consistent start, nq.
    pub qpos: Vec<f64>,
    /// Its velocities, nv.
    pub qvel: Vec<f64>,
    /// Activations there, na.
    pub act: Vec<f64>,
    /// Terms of the hard form.
    pub baumgarte: Baumgarte,
    /// What to note for an outside truth.
    pub observed: Option<Observed>,
    /// Whether energy is conserved, and so worth noting.
    pub conserved: bool,
    /// Whether limits, friction loss or contacts may act, and so are worth noting.
    pub inequalities: bool,
    /// Steps whose state is kept whole.
    pub snapshots: Vec<usize>,
}

impl Setup {
    /// A fresh data at the start.
    ///
    /// # Errors
    /// [`Error::Refused`]: the start is not of the model's size; [`Error::Mujoco`]: no memory.
    pub fn data(&self) -> Result<Data, Error> {
        let sizes = (self.qpos.len(), self.qvel.len());
        let expected = (self.model.nq(), self.model.nv());
        if sizes != expected {
            return Err(Error::Refused(format!(
                "the start has {} positions and {} velocities, expected {} and {}",
                sizes.0, sizes.1, expected.0, expected.1
            )));
        }
        if self.act.len() != self.model.na() {
            return Err(Error::Refused(format!(
                "the start has {} activations, expected {}",
                self.act.len(),
                self.model.na()
            )));
        }
        let mut data = Data::new(&self.model)?;
        data.qpos_mut().copy_from_slice(&self.qpos);
        data.qvel_mut().copy_from_slice(&self.qvel);
        data.act_mut().copy_from_slice(&self.act);
        Ok(data)
    }

    /// What the rows of the start leave open where they contradict one another, m or rad; 0 of a start that is merely open.
    ///
    /// # Errors
    /// Those of [`data`](Self::data), and [`Error::Mujoco`].
    pub fn left(&self) -> Result<f64, Error> {
        contradiction(&mut self.data()?)
    }

    /// The fields of its states.
    ///
    /// # Errors
    /// Those of [`State::new`].
    pub fn state(&self) -> Result<State, Error> {
        State::new(&self.model, self.baumgarte)
    }
}

/// A state kept whole, for what is published of it.
#[derive(Debug, Clone, PartialEq)]
pub struct Snapshot {
    /// Number of the step at whose start it is.
    pub step: usize,
    /// nq.
    pub qpos: Vec<f64>,
    /// nv.
    pub qvel: Vec<f64>,
    /// ne.
    pub multipliers: Vec<f64>,
}

/// What all experiments write down.
pub(crate) struct Notes {
    pub(crate) observed: Option<Observed>,
    pub(crate) inequalities: bool,
    conserved: bool,
    /// Whether a limit, friction loss or contact has pushed: energy is not conserved from then on.
    pushed: bool,
    due: Vec<usize>,
    kept: Vec<Snapshot>,
    acceleration: Vec<f64>,
}

impl Notes {
    pub(crate) fn new(setup: &Setup) -> Self {
        let mut due = setup.snapshots.clone();
        due.sort_unstable_by(|a, b| b.cmp(a));
        Self {
            observed: setup.observed,
            inequalities: setup.inequalities,
            conserved: setup.conserved,
            pushed: false,
            due,
            kept: Vec::new(),
            acceleration: Vec::new(),
        }
    }

    /// Step, time, positions, deviations, and what the truth speaks of.
    pub(crate) fn place(&self, steps: &mut Steps, step: usize, data: &Data) {
        steps.int("step", i64::try_from(step).unwrap_or(i64::MAX));
        steps.float("time_s", data.time());
        steps.float("drift_pos", largest(data.pos()));
        steps.float("drift_vel", largest(data.vel()));
        steps.list("qpos", data.qpos());
        steps.list("qvel", data.qvel());
        steps.list("ctrl", data.ctrl());
        if let Some(observed) = self.observed {
            steps.list("observed", observed.place(data));
        }
    }

    /// The same, and how far an acceleration (nv) leaves the rows.
    pub(crate) fn state(&mut self, steps: &mut Steps, step: usize, data: &Data, state: &State, qacc: &[f64]) {
        self.place(steps, step, data);
        steps.list("residual", data.pos());
        self.acceleration.resize(data.ne(), 0.0);
        data.jacobian_times(qacc, &mut self.acceleration);
        for (sum, curvature) in self.acceleration.iter_mut().zip(state.curvature()) {
            *sum += curvature;
        }
        steps.float("drift_acc", largest(&self.acceleration));
    }

    /// What a free run also shows, with its multipliers.
    pub(crate) fn free(&mut self, steps: &mut Steps, step: usize, data: &mut Data) -> Result<(), Error> {
        if self.conserved {
            self.pushed |= data.force()[data.ne()..].iter().any(|&force| force != 0.0);
            let [potential, kinetic] = data.energy()?;
            steps.maybe("energy", (!self.pushed).then_some(potential + kinetic));
            steps.maybe("kinetic_energy", (!self.pushed).then_some(kinetic));
        }
        if self.due.last() == Some(&step) {
            self.due.pop();
            self.kept.push(Snapshot {
                step,
                qpos: data.qpos().to_vec(),
                qvel: data.qvel().to_vec(),
                multipliers: data.multipliers().to_vec(),
            });
        }
        steps.list("multipliers", data.multipliers());
        Ok(())
    }

    pub(crate) fn take_snapshots(&mut self) -> Vec<Snapshot> {
        std::mem::take(&mut self.kept)
    }
}

/// One walk and whoever answers along it.
pub(crate) trait Experiment: Send + Sync {
    /// Nothing will be recorded any more: figures that are for records only need not be taken.
    fn unrecorded(&mut self) {}
    /// Computes what belongs to the present state.
    fn look(&mut self) -> Result<(), Error>;
    /// Writes the rows of a step, as far as they are known before it is taken.
    fn record(&mut self, step: usize) -> Result<(), Error>;
    /// Takes the step.
    fn step(&mut self) -> Result<(), Error>;
    /// Completes the rows.
    fn finish(&mut self, step_us: f64) -> Result<(), Error>;
    /// The walker's state.
    fn data(&self) -> &Data;
    /// A table for each who answers, in the order asked for.
    fn tables(&mut self) -> Vec<&mut Steps>;
    /// States kept whole since the last call.
    fn snapshots(&mut self) -> Vec<Snapshot>;
}

/// How a run ended.
#[derive(Debug, Clone, PartialEq)]
pub struct End {
    /// Step that it ended in.
    pub step: usize,
    /// Time of its state, s.
    pub time: f64,
    /// Why; `None`: the state is no longer finite, or beyond MuJoCo's bound.
    pub error: Option<Error>,
}

/// Goes on with many runs by so many steps each, on as many threads as there are cores (or `RAYON_NUM_THREADS`); as
/// [`Run::advance`], for each.
pub fn advance_all(runs: &mut [&mut Run], steps: usize) -> Vec<usize> {
    runs.par_iter_mut().map(|run| run.advance(steps)).collect()
}

/// Rows that room is made for at most.
const ROOM: usize = 10_000;

/// A run on its way.
pub struct Run {
    experiment: Box<dyn Experiment>,
    steps: usize,
    done: usize,
    rows: usize,
    end: Option<End>,
}

impl Run {
    pub(crate) fn new(experiment: impl Experiment + 'static, steps: usize) -> Self {
        Self { experiment: Box::new(experiment), steps, done: 0, rows: 0, end: None }
    }

    /// Goes on by so many steps, or to its end. Gives the number of steps taken; fewer than asked for: it has ended.
    pub fn advance(&mut self, steps: usize) -> usize {
        without_timers(|| self.advance_untimed(steps))
    }

    fn advance_untimed(&mut self, steps: usize) -> usize {
        let before = self.done;
        let until = self.steps.min(self.done + steps);
        while self.done < until && self.end.is_none() {
            let taken = self.take_step();
            let (step, time) = (self.done, self.experiment.data().time());
            match taken {
                Ok(true) => {}
                Ok(false) => {
                    self.end = Some(End { step, time, error: None });
                    break;
                }
                Err(error) => {
                    for table in self.experiment.tables() {
                        table.truncate(self.rows);
                    }
                    self.end = Some(End { step, time, error: Some(error) });
                    break;
                }
            }
            self.rows += 1;
            self.done += 1;
            if self.rows == 1 {
                for table in self.experiment.tables() {
                    table.reserve((until - self.done).min(ROOM));
                }
            }
            if !is_sane(self.experiment.data()) {
                self.end = Some(End { step, time, error: None });
            }
        }
        self.done - before
    }

    /// Whether it was taken: from accelerations beyond bounds it is not.
    fn take_step(&mut self) -> Result<bool, Error> {
        let began = Instant::now();
        self.experiment.look()?;
        let looked = began.elapsed();
        if !bounded(self.experiment.data().qacc()) {
            return Ok(false);
        }
        self.experiment.record(self.done)?;
        let began = Instant::now();
        self.experiment.step()?;
        let taken = began.elapsed();
        self.experiment.finish(1e6 * (looked + taken).as_secs_f64())?;
        Ok(true)
    }

    /// Takes all steps that are left without writing anything down: what the walk itself costs.
    ///
    /// # Errors
    /// What ended it.
    pub fn walk(&mut self) -> Result<(), Error> {
        without_timers(|| self.walk_timed())
    }

    /// The same with MuJoCo's timers running: what a process that imported it pays for a step.
    ///
    /// # Errors
    /// What ended it.
    pub fn walk_timed(&mut self) -> Result<(), Error> {
        self.experiment.unrecorded();
        while self.done < self.steps {
            self.experiment.look()?;
            self.experiment.step()?;
            self.done += 1;
        }
        Ok(())
    }

    /// How it ended before its last step, if it did.
    #[must_use]
    pub const fn end(&self) -> Option<&End> {
        self.end.as_ref()
    }

    /// The walker's state.
    #[must_use]
    pub fn data(&self) -> &Data {
        self.experiment.data()
    }

    /// The rows since the last call, a table for each who answers.
    pub fn take_tables(&mut self) -> Vec<Vec<(&'static str, Column)>> {
        self.rows = 0;
        self.experiment.tables().into_iter().map(Steps::take).collect()
    }

    /// The states kept whole since the last call.
    pub fn take_snapshots(&mut self) -> Vec<Snapshot> {
        self.experiment.snapshots()
    }
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use crate::library::testing::model;

    /// A walk that goes wrong when it is told to.
    struct Scripted {
        data: Data,
        steps: Steps,
        recorded: bool,
        taken: usize,
        /// Step whose integration fails, and the one that leads to no number.
        fails: Option<usize>,
        explodes: Option<usize>,
    }

    impl Experiment for Scripted {
        fn unrecorded(&mut self) {
            self.recorded = false;
        }

        fn look(&mut self) -> Result<(), Error> {
            self.data.position_stage()
        }

        fn record(&mut self, step: usize) -> Result<(), Error> {
            assert!(self.recorded && step == self.taken, "step {step} after {}", self.taken);
            self.steps.int("step", i64::try_from(step).expect("few"));
            self.steps.float("time_s", self.data.time());
            Ok(())
        }

        fn step(&mut self) -> Result<(), Error> {
            if self.fails == Some(self.taken) {
                return Err(Error::Refused("as it was told to".to_owned()));
            }
            if self.explodes == Some(self.taken) {
                self.data.qpos_mut()[0] = f64::NAN;
            }
            self.taken += 1;
            let time = self.data.time();
            self.data.set_time(time + 0.5);
            Ok(())
        }

        fn finish(&mut self, step_us: f64) -> Result<(), Error> {
            self.steps.float("step_us", step_us);
            Ok(())
        }

        fn data(&self) -> &Data {
            &self.data
        }

        fn tables(&mut self) -> Vec<&mut Steps> {
            vec![&mut self.steps]
        }

        fn snapshots(&mut self) -> Vec<Snapshot> {
            Vec::new()
        }
    }

    const SLIDE: &str =
        r#"<mujoco><worldbody><body><joint type="slide"/><geom size=".1"/></body></worldbody></mujoco>"#;

    fn scripted(steps: usize, fails: Option<usize>, explodes: Option<usize>) -> Run {
        let data = Data::new(&model(SLIDE)).expect("memory");
        Run::new(Scripted { data, steps: Steps::default(), recorded: true, taken: 0, fails, explodes }, steps)
    }

    /// Numbers of the steps that were written down since the last call; every column has as many rows.
    fn written(run: &mut Run) -> Vec<i64> {
        let table = run.take_tables().remove(0);
        let mut numbers = Vec::new();
        for (name, column) in &table {
            match column {
                Column::Int { values, .. } => numbers.clone_from(values),
                Column::Float { values, .. } => assert_eq!(values.len(), numbers.len(), "{name}"),
                _ => panic!("{name}"),
            }
        }
        numbers
    }

    #[test]
    fn a_run_is_taken_in_portions_and_ends_where_it_was_to_end() {
        let mut run = scripted(5, None, None);
        assert_eq!((run.advance(2), written(&mut run)), (2, vec![0, 1]));
        assert_eq!(run.advance(1) + run.advance(1), 2);
        assert_eq!(written(&mut run), [2, 3]);
        assert_eq!((run.advance(10), written(&mut run)), (1, vec![4]));
        assert_eq!((run.advance(10), run.take_tables()), (0, vec![vec![]]));
        assert_eq!((run.end(), run.data().time()), (None, 2.5));
    }

    #[test]
    fn a_step_that_fails_half_way_leaves_no_row_and_ends_the_run() {
        let mut run = scripted(5, Some(3), None);
        assert_eq!((run.advance(2), written(&mut run)), (2, vec![0, 1]));
        assert_eq!((run.advance(5), written(&mut run)), (1, vec![2]));
        let error = Some(Error::Refused("as it was told to".to_owned()));
        assert_eq!(run.end(), Some(&End { step: 3, time: 1.5, error }));
        assert_eq!((run.advance(5), run.take_tables()), (0, vec![vec![]]));
    }

    #[test]
    fn a_state_without_numbers_ends_the_run_after_the_row_of_its_step() {
        let mut run = scripted(5, None, Some(1));
        assert_eq!((run.advance(5), written(&mut run)), (2, vec![0, 1]));
        assert_eq!(run.end(), Some(&End { step: 1, time: 1.0, error: None }));
    }

    #[test]
    fn a_walk_writes_nothing_down_and_says_what_ended_it() {
        let mut run = scripted(5, None, None);
        assert_eq!((run.walk(), run.take_tables()), (Ok(()), vec![vec![]]));
        assert_eq!((run.advance(1), run.data().time()), (0, 2.5));
        assert_eq!(scripted(5, Some(2), None).walk(), Err(Error::Refused("as it was told to".to_owned())));
    }

    #[test]
    fn many_runs_go_on_each_for_itself() {
        let mut runs = [scripted(3, None, None), scripted(9, None, None), scripted(9, Some(1), None)];
        let taken = advance_all(&mut runs.iter_mut().collect::<Vec<_>>(), 4);
        assert_eq!(taken, [3, 4, 1]);
        assert_eq!(runs.map(|run| run.end().is_some()), [false, false, true]);
    }

    #[test]
    fn a_start_of_another_size_is_refused_with_both() {
        let setup = Setup {
            model: model(SLIDE),
            drive: Drive::default(),
            qpos: vec![0.0; 2],
            qvel: vec![0.0],
            act: Vec::new(),
            baumgarte: Baumgarte::default(),
            observed: None,
            conserved: false,
            inequalities: false,
            snapshots: Vec::new(),
        };
        let refused = setup.data().err().expect("another size").to_string();
        assert_eq!(refused, "the start has 2 positions and 1 velocities, expected 1 and 1");
    }
}
