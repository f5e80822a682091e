//! Random mechanisms on kinematic trees: M = Lᵀ D L along the tree, and loops that tie branches together.

use nalgebra::{DMatrix, DVector};
use oarlock_core::test_problems::sequence::Random;
use oarlock_core::{JacobianView, SparseStep, StepView, TreeView};

/// One step of such a mechanism, dense and sparse.
#[derive(Debug, Clone)]
pub struct TreeStep {
    lengths: Vec<i32>,
    starts: Vec<i32>,
    columns: Vec<i32>,
    mass: Vec<f64>,
    factor: Vec<f64>,
    inverse_diagonal: Vec<f64>,
    /// M, nv×nv.
    pub dense_mass: DMatrix<f64>,
    /// J, n×nv.
    pub jacobian: DMatrix<f64>,
    rows: (Vec<i32>, Vec<i32>, Vec<i32>, Vec<f64>),
    flat: Vec<f64>,
    force: Vec<f64>,
    unconstrained: Vec<f64>,
    /// aref, n.
    pub aref: Vec<f64>,
}

/// What a random mechanism is made of.
#[derive(Debug, Clone, Copy)]
pub struct Shape {
    /// Number of velocities.
    pub nv: usize,
    /// How far up the tree a velocity may hang: 1 makes a chain, nv a bush.
    pub spread: usize,
    /// Independent rows, each of three velocities.
    pub loops: usize,
    /// Rows that are sums of two others, and rows that are multiples of one.
    pub sums: usize,
    pub copies: usize,
    /// Whether rows ask for what they can have.
    pub consistent: bool,
}

impl TreeStep {
    /// A mechanism of this shape. The numbers of `moved` move those of `seed` a little, along a path.
    ///
    /// # Panics
    /// If its numbers do not fit together, which would be a mistake here.
    #[must_use]
    pub fn random(seed: u64, shape: Shape, moved: f64) -> Self {
        let Shape { nv, spread, loops, sums, copies, consistent } = shape;
        let mut random = Random::new(seed);
        let parents: Vec<Option<usize>> =
            (0..nv)
                .map(|at| {
                    if at == 0 || random.one_in(6) {
                        None
                    } else {
                        Some(at - 1 - random.below(spread.min(at)))
                    }
                })
                .collect();
        let triples: Vec<[usize; 3]> =
            (0..loops).map(|at| [at % nv, random.below(nv), random.below(nv)]).collect();
        let pairs: Vec<[usize; 2]> = (0..sums).map(|_| [random.below(loops), random.below(loops)]).collect();
        let sources: Vec<usize> = (0..copies).map(|_| random.below(loops)).collect();
        let mut number = |scale: f64| scale * (random.uniform(-1.0, 1.0) + moved * random.uniform(-1.0, 1.0));
        let mut lower = DMatrix::<f64>::identity(nv, nv);
        for at in 0..nv {
            let mut above = parents[at];
            while let Some(other) = above {
                lower[(at, other)] = number(0.6);
                above = parents[other];
            }
        }
        let diagonal = DVector::from_fn(nv, |_, _| 1.5 + number(1.0).abs());
        let dense_mass = lower.transpose() * DMatrix::from_diagonal(&diagonal) * &lower;
        let mut rows: Vec<DVector<f64>> = triples
            .iter()
            .map(|triple| {
                let mut row = DVector::zeros(nv);
                for &at in triple {
                    row[at] += 0.3 + number(1.0);
                }
                row
            })
            .collect();
        for pair in &pairs {
            rows.push(&rows[pair[0]] + &rows[pair[1]] * 0.5);
        }
        for &source in &sources {
            rows.push(&rows[source] * -2.0);
        }
        let n = rows.len();
        let jacobian = DMatrix::from_fn(n, nv, |row, column| rows[row][column]);
        let force = DVector::from_fn(nv, |_, _| number(5.0));
        let wanted = DVector::from_fn(nv, |_, _| number(3.0));
        let aref = if consistent { &jacobian * wanted } else { DVector::from_fn(n, |_, _| number(3.0)) };
        let unconstrained = dense_mass.clone().cholesky().expect("definite").solve(&force);
        let mut step = Self {
            lengths: Vec::new(),
            starts: Vec::new(),
            columns: Vec::new(),
            mass: Vec::new(),
            factor: Vec::new(),
            inverse_diagonal: diagonal.iter().map(|entry| entry.recip()).collect(),
            flat: jacobian.transpose().as_slice().to_vec(),
            rows: compressed(&jacobian),
            dense_mass,
            jacobian,
            force: force.as_slice().to_vec(),
            unconstrained: unconstrained.as_slice().to_vec(),
            aref: aref.as_slice().to_vec(),
        };
        for at in 0..nv {
            let (mut line, mut above) = (vec![at], parents[at]);
            while let Some(other) = above {
                line.push(other);
                above = parents[other];
            }
            line.reverse();
            step.starts.push(i32::try_from(step.columns.len()).expect("few"));
            step.lengths.push(i32::try_from(line.len()).expect("few"));
            for &other in &line {
                step.columns.push(i32::try_from(other).expect("few"));
                step.mass.push(step.dense_mass[(at, other)]);
                step.factor.push(lower[(at, other)]);
            }
        }
        step
    }

    /// The same with its last `count` rows turned by about `gap`, as loops that stand open turn what is redundant.
    #[must_use]
    pub fn opened(mut self, count: usize, gap: f64) -> Self {
        let n = self.jacobian.nrows();
        for row in n - count..n {
            let mut turned = 1.0;
            for entry in self.jacobian.row_mut(row).iter_mut().filter(|entry| **entry != 0.0) {
                *entry *= 1.0 + gap * turned;
                turned *= -0.7;
            }
        }
        self.flat = self.jacobian.transpose().as_slice().to_vec();
        self.rows = compressed(&self.jacobian);
        self
    }

    /// It as it is, J compressed.
    #[must_use]
    pub fn sparse(&self) -> SparseStep<'_> {
        let (lengths, starts, columns, values) = &self.rows;
        SparseStep {
            jacobian: JacobianView::Compressed { lengths, starts, columns, values },
            ..self.sparse_of_dense()
        }
    }

    /// It with J dense.
    #[must_use]
    pub fn sparse_of_dense(&self) -> SparseStep<'_> {
        SparseStep {
            jacobian: JacobianView::Dense(&self.flat),
            inertia: TreeView {
                lengths: &self.lengths,
                starts: &self.starts,
                columns: &self.columns,
                mass: &self.mass,
                factor: &self.factor,
                inverse_diagonal: &self.inverse_diagonal,
            },
            unconstrained: &self.unconstrained,
            aref: &self.aref,
            regularisation: None,
        }
    }

    /// It as a dense step.
    #[must_use]
    pub fn dense(&self) -> StepView<'_> {
        StepView {
            mass: self.dense_mass.as_slice(),
            jacobian: &self.flat,
            force: &self.force,
            aref: &self.aref,
            regularisation: None,
        }
    }
}

/// Lengths, starts, columns and entries of rows, with a zero in the pattern of each.
fn compressed(jacobian: &DMatrix<f64>) -> (Vec<i32>, Vec<i32>, Vec<i32>, Vec<f64>) {
    let (mut lengths, mut starts, mut columns, mut values) = (vec![], vec![], vec![], vec![]);
    for row in jacobian.row_iter() {
        let first = columns.len();
        starts.push(i32::try_from(first).expect("few"));
        for (column, &value) in row.iter().enumerate() {
            if value != 0.0 || column == 0 {
                columns.push(i32::try_from(column).expect("few"));
                values.push(value);
            }
        }
        lengths.push(i32::try_from(columns.len() - first).expect("few"));
    }
    (lengths, starts, columns, values)
}
