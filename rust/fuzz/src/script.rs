//! What is fed to a solver: options, then steps, with copies, resets and saved states in between, all read from bytes.

use arbitrary::{Result, Unstructured};
use oarlock_core::Wanted;
use oarlock_core::params::Value;

use crate::number::{Palette, SPECIAL};

/// Most rows and velocities of a step.
pub const ROWS: usize = 12;
const VELOCITIES: usize = 9;
/// Most actions of a script.
const ACTIONS: usize = 8;

/// A and b as a caller would hand them over.
#[derive(Debug, Clone)]
pub enum Input {
    /// For [`assemble`](oarlock_core::ConstrainedSystem::assemble).
    Step(Step),
    /// For [`set_dense`](oarlock_core::ConstrainedSystem::set_dense).
    Dense(Dense),
}

/// The arrays of a [`StepView`](oarlock_core::StepView), right or wrong.
#[derive(Debug, Clone)]
pub struct Step {
    /// M.
    pub mass: Vec<f64>,
    /// J.
    pub jacobian: Vec<f64>,
    /// f.
    pub force: Vec<f64>,
    /// aref.
    pub aref: Vec<f64>,
    /// R.
    pub softness: Option<Vec<f64>>,
}

/// A and b, right or wrong.
#[derive(Debug, Clone)]
pub struct Dense {
    /// A.
    pub matrix: Vec<f64>,
    /// b.
    pub rhs: Vec<f64>,
    /// B with A = B Bᵀ, if A was made that way: positive semidefinite by construction.
    factor: Option<Vec<f64>>,
}

impl Dense {
    /// Whether A is a product B Bᵀ.
    #[must_use]
    pub const fn is_gram(&self) -> bool {
        self.factor.is_some()
    }
}

/// One thing that a caller does.
#[derive(Debug, Clone)]
pub enum Action {
    /// Fills the system and solves it.
    Solve(Input, Wanted),
    /// Forgets.
    Reset,
    /// Goes on with a copy.
    Copy,
    /// Goes on with a new solver that takes the saved state.
    Restore,
    /// The same, from a state with one thing changed.
    Corrupt(Corruption),
}

/// What is changed in a saved state.
#[derive(Debug, Clone, Copy)]
pub enum Corruption {
    /// An entry of a field.
    Entry(u8, u8, f64),
    /// A field loses its last entry.
    Cut(u8),
    /// A field is not there.
    Missing(u8),
    /// A field that nobody knows.
    Unknown,
    /// Another size n.
    Size(usize),
    /// No fields of another size.
    Emptied(usize),
}

/// A session with one solver.
#[derive(Debug, Clone)]
pub struct Script {
    /// Number of an option and its value.
    pub options: Vec<(u8, Value)>,
    /// In this order.
    pub actions: Vec<Action>,
}

impl Script {
    /// Reads a script; any bytes are one.
    ///
    /// # Errors
    /// None in practice: where the bytes end, the rest is zeros.
    pub fn read(u: &mut Unstructured<'_>) -> Result<Self> {
        let mut options = Vec::new();
        for _ in 0..u.int_in_range(0..=4_u8)?.saturating_sub(1) {
            options.push((u.arbitrary()?, *u.choose(&OPTION_VALUES)?));
        }
        let mut actions = Vec::new();
        let mut last = None;
        while !u.is_empty() && actions.len() < ACTIONS {
            actions.push(match u.int_in_range(0..=15_u8)? {
                0 => Action::Reset,
                1 => Action::Copy,
                2 => Action::Restore,
                3 => Action::Corrupt(corruption(u)?),
                kind => {
                    let input = input(u, kind, last.take())?;
                    last = Some(input.clone());
                    let wanted = if u.ratio(1, 4)? { Wanted::Acceleration } else { Wanted::Multipliers };
                    Action::Solve(input, wanted)
                }
            });
        }
        Ok(Self { options, actions })
    }
}

const OPTION_VALUES: [Value; 22] = [
    Value::Switch(false),
    Value::Switch(true),
    Value::Integer(-1),
    Value::Integer(0),
    Value::Integer(1),
    Value::Integer(3),
    Value::Integer(10),
    Value::Integer(i64::MAX),
    Value::Float(0.0),
    Value::Float(1.0),
    Value::Float(2.0),
    Value::Float(0.5),
    Value::Float(0.25),
    Value::Float(0.999),
    Value::Float(1e-3),
    Value::Float(1e-6),
    Value::Float(1e-10),
    Value::Float(1e-14),
    Value::Float(5e-324),
    Value::Float(1e300),
    Value::Float(-1.0),
    Value::Float(f64::NAN),
];

fn corruption(u: &mut Unstructured<'_>) -> Result<Corruption> {
    Ok(match u.int_in_range(0..=7_u8)? {
        0..=2 => Corruption::Entry(u.arbitrary()?, u.arbitrary()?, *u.choose(&SPECIAL)?),
        3 => Corruption::Cut(u.arbitrary()?),
        4 => Corruption::Missing(u.arbitrary()?),
        5 => Corruption::Unknown,
        6 => Corruption::Size(*u.choose(&SIZES)?),
        _ => Corruption::Emptied(*u.choose(&SIZES)?),
    })
}

const SIZES: [usize; 6] = [0, 1, 2, 3, 1 << 40, usize::MAX];

fn input(u: &mut Unstructured<'_>, kind: u8, last: Option<Input>) -> Result<Input> {
    match (kind, last) {
        // The same again, or moved a little: what a solver carries must help, not harm.
        (4..=8, Some(Input::Step(step))) => Ok(Input::Step(moved_step(u, step)?)),
        (4..=8, Some(Input::Dense(dense))) => Ok(Input::Dense(moved_dense(u, dense)?)),
        (9..=12, _) => Ok(Input::Step(step(u)?)),
        _ => Ok(Input::Dense(dense(u)?)),
    }
}

/// An array of another length, now and then.
fn maybe_cut(u: &mut Unstructured<'_>, array: &mut Vec<f64>) -> Result<()> {
    match u.arbitrary::<u8>()? {
        254 => _ = array.pop(),
        255 => array.push(0.0),
        _ => {}
    }
    Ok(())
}

fn step(u: &mut Unstructured<'_>) -> Result<Step> {
    let palette = Palette::read(u)?;
    let (n, nv) = (u.int_in_range(0..=ROWS)?, u.int_in_range(0..=VELOCITIES)?);
    let mut mass = vec![0.0; nv * nv];
    match u.int_in_range(0..=3_u8)? {
        0 => mass.iter_mut().step_by(nv + 1).for_each(|entry| *entry = 1.0),
        1 => {
            for i in 0..nv {
                mass[i * nv + i] = palette.number(u)?.abs().max(palette.unit());
            }
        }
        2 => {
            let factor = palette.numbers(u, nv * nv)?;
            mass = gram(&factor, nv);
            mass.iter_mut().step_by(nv + 1).for_each(|entry| *entry += palette.unit());
        }
        _ => mass = palette.numbers(u, nv * nv)?,
    }
    let mut jacobian = palette.numbers(u, n * nv)?;
    for _ in 0..u.int_in_range(0..=3_u8)? {
        if n > 0 {
            let (from, to) = (u.int_in_range(0..=n - 1)?, u.int_in_range(0..=n - 1)?);
            let factor = Palette::Small.number(u)?;
            for col in 0..nv {
                jacobian[to * nv + col] = factor * jacobian[from * nv + col];
            }
        }
    }
    let palette = if u.ratio(1, 4)? { Palette::read(u)? } else { Palette::Small };
    let (mut force, mut aref) = (palette.numbers(u, nv)?, palette.numbers(u, n)?);
    let softness = if u.ratio(1, 4)? {
        let mut softness = palette.numbers(u, n)?;
        if !u.ratio(1, 8)? {
            for entry in &mut softness {
                *entry = entry.abs();
            }
        }
        maybe_cut(u, &mut softness)?;
        Some(softness)
    } else {
        None
    };
    for array in [&mut mass, &mut jacobian, &mut force, &mut aref] {
        maybe_cut(u, array)?;
    }
    Ok(Step { mass, jacobian, force, aref, softness })
}

fn dense(u: &mut Unstructured<'_>) -> Result<Dense> {
    let palette = Palette::read(u)?;
    let n = u.int_in_range(0..=ROWS)?;
    let mut factor = None;
    let mut matrix = match u.int_in_range(0..=7_u8)? {
        0..=5 => {
            let rank = u.int_in_range(0..=n)?;
            let b = palette.numbers(u, n * rank)?;
            let matrix = if n == 0 { Vec::new() } else { gram(&b, n) };
            factor = Some(b);
            matrix
        }
        6 => {
            let mut matrix = palette.numbers(u, n * n)?;
            for row in 0..n {
                for col in 0..row {
                    matrix[row * n + col] = matrix[col * n + row];
                }
            }
            matrix
        }
        _ => palette.numbers(u, n * n)?,
    };
    let palette = if u.ratio(1, 4)? { Palette::read(u)? } else { Palette::Small };
    let mut rhs = palette.numbers(u, n)?;
    maybe_cut(u, &mut matrix)?;
    maybe_cut(u, &mut rhs)?;
    Ok(Dense { matrix, rhs, factor })
}

/// B Bᵀ of B (`n×r`, row-major); symmetric to the last bit.
fn gram(factor: &[f64], n: usize) -> Vec<f64> {
    let rank = factor.len() / n.max(1);
    let row = |i: usize| &factor[i * rank..(i + 1) * rank];
    (0..n * n).map(|at| row(at / n).iter().zip(row(at % n)).map(|(a, b)| a * b).sum()).collect()
}

fn moved_step(u: &mut Unstructured<'_>, mut step: Step) -> Result<Step> {
    for _ in 0..u.int_in_range(0..=3_u8)? {
        match u.int_in_range(0..=7_u8)? {
            0 => nudge(u, &mut step.mass)?,
            1 => nudge(u, &mut step.force)?,
            2 => nudge(u, &mut step.aref)?,
            3 => step.softness = None,
            4 => nudge(u, step.softness.get_or_insert_with(|| vec![0.0; step.aref.len()]))?,
            _ => nudge(u, &mut step.jacobian)?,
        }
    }
    Ok(step)
}

fn moved_dense(u: &mut Unstructured<'_>, mut dense: Dense) -> Result<Dense> {
    let n = dense.rhs.len();
    for _ in 0..u.int_in_range(0..=3_u8)? {
        if u.ratio(1, 4)? {
            nudge(u, &mut dense.rhs)?;
        } else if let Some(factor) = dense.factor.as_mut().filter(|_| dense.matrix.len() == n * n) {
            nudge(u, factor)?;
            dense.matrix = gram(factor, n);
        } else {
            nudge(u, &mut dense.matrix)?;
        }
    }
    Ok(dense)
}

/// Another entry, or one a little larger.
fn nudge(u: &mut Unstructured<'_>, array: &mut [f64]) -> Result<()> {
    let index = usize::from(u.arbitrary::<u8>()?);
    let change = match u.int_in_range(0..=63_u8)? {
        0 => *u.choose(&SPECIAL)?,
        exponent => (8.0 - f64::from(exponent)).exp2(),
    };
    let set = u.ratio(1, 4)?;
    if !array.is_empty() {
        let index = index % array.len();
        let entry = &mut array[index];
        *entry = if set { change } else { *entry + change };
    }
    Ok(())
}
