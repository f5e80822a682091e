//! Everyone answers the same questions along one walk.

use oarlock_core::{ConstrainedSystem, Status};

use super::Solver;
use super::common::{MujocoWalker, projecting, proving, pushing};
use crate::error::Error;
use crate::force::{Answer, SolvedForce, Tally};
use crate::inequalities::Inequalities;
use crate::library::Data;
use crate::projection::Projector;
use crate::run::{Experiment, Notes, Run, Setup, Snapshot};
use crate::state::{Form, State};
use crate::steps::Steps;
use crate::vectors::relative_difference;
use crate::walker::ForcedWalker;

/// Who walks in lockstep.
enum Leader {
    Mujoco(Box<(MujocoWalker, State)>),
    Solver(Box<ForcedWalker<SolvedForce>>),
}

/// A question of a form with everyone who answers it.
struct Question {
    form: Form,
    system: ConstrainedSystem,
    inequalities: Inequalities,
    answer: Answer,
    solvers: Vec<(Solver, Steps)>,
}

struct Lockstep {
    leader: Leader,
    questions: Vec<Question>,
    notes: Notes,
    qacc: Vec<f64>,
    qfrc: Vec<f64>,
    own: [Vec<f64>; 3],
    /// How far MuJoCo's own answer here is from the minimum that it is after.
    gradient: f64,
}

/// A form, and who answers in it.
pub type Asked = (Form, Vec<Solver>);

/// One engine walks; at each of its states every solver answers the same question, and MuJoCo its own. `leader` is a solver
/// that walks in the hard form with what ends its steps, or none for MuJoCo.
///
/// # Errors
/// Those of [`ForcedWalker::new`] and [`State::new`].
pub fn lockstep(
    setup: &Setup,
    leader: Option<(Solver, Option<Projector>)>,
    asked: Vec<Asked>,
    steps: usize,
) -> Result<Run, Error> {
    let nv = setup.model.nv();
    let leader = match leader {
        None => Leader::Mujoco(Box::new((MujocoWalker::new(setup)?, setup.state()?))),
        Some((solver, projector)) => {
            let force = SolvedForce::new(setup.state()?, Form::Hard, solver, nv);
            Leader::Solver(Box::new(ForcedWalker::new(setup.data()?, setup.drive.clone(), force, projector)?))
        }
    };
    let question = |(form, solvers): Asked| Question {
        form,
        system: ConstrainedSystem::new(),
        inequalities: Inequalities::default(),
        answer: Answer::new(nv),
        solvers: solvers.into_iter().map(|solver| (solver, Steps::default())).collect(),
    };
    let experiment = Lockstep {
        leader,
        questions: asked.into_iter().map(question).collect(),
        notes: Notes::new(setup),
        qacc: vec![0.0; nv],
        qfrc: vec![0.0; nv],
        own: [vec![0.0; nv], vec![0.0; nv], Vec::new()],
        gradient: 0.0,
    };
    Ok(Run::new(experiment, steps))
}

impl Lockstep {
    /// MuJoCo's own acceleration and constraint force here; the leader's are put back.
    fn ask_mujoco(&mut self) -> Result<(), Error> {
        let theirs = match &mut self.leader {
            Leader::Mujoco(theirs) => {
                let (walker, state) = &mut **theirs;
                state.read(&mut walker.data)?;
                if self.notes.inequalities {
                    self.gradient = walker.data.gradient()?;
                }
                self.qacc.copy_from_slice(walker.data.qacc());
                self.qfrc.copy_from_slice(walker.data.qfrc_constraint());
                return Ok(());
            }
            Leader::Solver(walker) => {
                walker.force.state.read(&mut walker.data)?;
                &mut walker.data
            }
        };
        let [qacc, qfrc, force] = &mut self.own;
        qacc.copy_from_slice(theirs.qacc());
        qfrc.copy_from_slice(theirs.qfrc_constraint());
        force.clear();
        force.extend_from_slice(theirs.force());
        theirs.constraint_stage()?;
        if self.notes.inequalities {
            self.gradient = theirs.gradient()?;
        }
        self.qacc.copy_from_slice(theirs.qacc());
        self.qfrc.copy_from_slice(theirs.qfrc_constraint());
        theirs.qacc_mut().copy_from_slice(qacc);
        theirs.qfrc_constraint_mut().copy_from_slice(qfrc);
        theirs.force_mut().copy_from_slice(force);
        Ok(())
    }
}

impl Experiment for Lockstep {
    fn look(&mut self) -> Result<(), Error> {
        match &mut self.leader {
            Leader::Mujoco(theirs) => theirs.0.look(),
            Leader::Solver(walker) => {
                walker.force.tally = Tally::default();
                walker.look()
            }
        }
    }

    fn record(&mut self, step: usize) -> Result<(), Error> {
        self.ask_mujoco()?;
        let (data, state) = match &mut self.leader {
            Leader::Mujoco(theirs) => (&mut theirs.0.data, &mut theirs.1),
            Leader::Solver(walker) => (&mut walker.data, &mut walker.force.state),
        };
        for question in &mut self.questions {
            let Question { form, system, inequalities, answer, solvers } = question;
            state.ask(data, *form, system, inequalities)?;
            let mut remembered = false;
            for (solver, steps) in solvers {
                answer.fill(data, state, system, inequalities, &mut **solver)?;
                if !remembered && answer.info.status == Status::Converged {
                    inequalities.remember(&answer.qacc);
                    remembered = true;
                }
                self.notes.state(steps, step, data, state, &answer.qacc);
                let mut tally = Tally::default();
                tally.add(&answer.info, answer.elapsed);
                if self.notes.inequalities {
                    tally.add_inequalities(inequalities);
                    pushing(steps, state.others(), inequalities);
                    proving(steps, &tally);
                    let known = !state.others().is_empty();
                    steps.maybe("mujoco_optimality", known.then_some(self.gradient));
                }
                let (multipliers, known) = system.reference(&**solver)?;
                tally.write(steps, known);
                steps.float("min_norm_error", relative_difference(&answer.multipliers, multipliers));
                steps.float("qacc_rel_diff", relative_difference(&answer.qacc, &self.qacc));
                steps.float("qfrc_constraint_rel_diff", relative_difference(&answer.qfrc, &self.qfrc));
                steps.list("multipliers", &answer.multipliers);
            }
        }
        Ok(())
    }

    fn step(&mut self) -> Result<(), Error> {
        match &mut self.leader {
            Leader::Mujoco(theirs) => theirs.0.step(),
            Leader::Solver(walker) => walker.step(),
        }
    }

    fn finish(&mut self, step_us: f64) -> Result<(), Error> {
        let projector = match &self.leader {
            Leader::Mujoco(_) => None,
            Leader::Solver(walker) => walker.projector.as_ref(),
        };
        for (_, steps) in self.questions.iter_mut().flat_map(|question| &mut question.solvers) {
            projecting(steps, projector);
            steps.float("step_us", step_us);
        }
        Ok(())
    }

    fn data(&self) -> &Data {
        match &self.leader {
            Leader::Mujoco(theirs) => &theirs.0.data,
            Leader::Solver(walker) => &walker.data,
        }
    }

    fn tables(&mut self) -> Vec<&mut Steps> {
        self.questions.iter_mut().flat_map(|question| &mut question.solvers).map(|(_, steps)| steps).collect()
    }

    fn snapshots(&mut self) -> Vec<Snapshot> {
        self.notes.take_snapshots()
    }
}
