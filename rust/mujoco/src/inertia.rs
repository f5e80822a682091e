//! Systems assembled through MuJoCo's own factor of M, which is sparse: M⁻¹ = Hᵀ H with H = D^(−1/2) L^(−T).

use oarlock_core::{ConstrainedSystem, FactoredStep, JacobianView, SparseStep};

use crate::error::Error;
use crate::library::Data;

/// Up to as many velocities rows are handed over dense, which costs less than their pattern does.
const SMALL: usize = 8;

/// Assembles systems of one model's states, and goes the way back from their multipliers.
#[derive(Debug, Clone)]
pub struct Inertia {
    /// J of a small system.
    rows: Vec<f64>,
    roots: Vec<f64>,
    change: Vec<f64>,
}

impl Inertia {
    /// For states of nv velocities.
    #[must_use]
    pub fn new(nv: usize) -> Self {
        Self { rows: Vec::new(), roots: vec![0.0; nv], change: vec![0.0; nv] }
    }

    /// Assembles a system of the equality rows of a data whose position stage is valid, from a₀ (nv), aref (ne) and, of soft rows,
    /// R (ne).
    ///
    /// # Errors
    /// Those of [`ConstrainedSystem::assemble_sparse`] and [`ConstrainedSystem::assemble_factored`], and [`Error::Mujoco`].
    pub fn assemble(
        &mut self,
        data: &mut Data,
        unconstrained: &[f64],
        aref: &[f64],
        regularisation: Option<&[f64]>,
        system: &mut ConstrainedSystem,
    ) -> Result<(), Error> {
        if unconstrained.len() <= SMALL
            && let JacobianView::Dense(rows) = data.jacobian()
        {
            self.rows.clear();
            self.rows.extend_from_slice(rows);
            self.find_roots(data);
            let step = FactoredStep { jacobian: &self.rows, unconstrained, aref, regularisation };
            let (roots, mut said) = (&self.roots, Ok(()));
            let mut whiten = |_: &[usize], rows: &[f64], whitened: &mut [f64]| {
                said = data.whiten(whitened, rows, roots);
            };
            system.assemble_factored(&step, &mut whiten)?;
            return said;
        }
        let (jacobian, inertia) = (data.jacobian(), data.inertia());
        system.assemble_sparse(&SparseStep { jacobian, inertia, unconstrained, aref, regularisation })?;
        Ok(())
    }

    fn find_roots(&mut self, data: &Data) {
        for (root, inverse) in self.roots.iter_mut().zip(data.inverse_diagonal()) {
            *root = inverse.sqrt();
        }
    }

    /// `whitened` = H `vectors`, several of nv one after another, at a state whose position stage is valid.
    ///
    /// # Errors
    /// [`Error::Mujoco`].
    pub fn whiten(&mut self, data: &mut Data, vectors: &[f64], whitened: &mut [f64]) -> Result<(), Error> {
        self.find_roots(data);
        data.whiten(whitened, vectors, &self.roots)
    }

    /// `qfrc` = Jᵀ λ and `qacc` = a₀ + M⁻¹ Jᵀ λ, nv each.
    ///
    /// # Errors
    /// Those of [`ConstrainedSystem::force`], and [`Error::Mujoco`].
    pub fn acceleration(
        &mut self,
        data: &mut Data,
        system: &mut ConstrainedSystem,
        multipliers: &[f64],
        qfrc: &mut [f64],
        qacc: &mut [f64],
    ) -> Result<(), Error> {
        system.force(multipliers, qfrc)?;
        data.solve_mass(&mut self.change, qfrc)?;
        for ((sum, start), change) in qacc.iter_mut().zip(system.unconstrained().iter()).zip(&self.change) {
            *sum = start + change;
        }
        Ok(())
    }
}

#[cfg(all(test, unix))]
mod tests {
    use crate::library::testing::{data, model, some, somewhere};
    use crate::vectors::sum;

    #[test]
    fn whitened_vectors_have_the_inner_products_of_the_inverse_of_m() {
        let model = model(
            r#"<mujoco><worldbody><body><freejoint/><geom type="box" size=".1 .2 .3"/>
              <body pos=".4 0 0"><joint type="ball"/><geom size=".1" pos=".2 0 .1"/>
                <body pos=".3 0 0"><joint type="hinge" axis="0 1 0"/><geom size=".1" pos=".2 0 0"/></body></body>
              <body pos="-.4 0 0"><joint type="slide" axis="1 1 0"/><geom size=".1"/></body></body></worldbody></mujoco>"#,
        );
        let (qpos, qvel) = somewhere(&model);
        let mut state = data(&model, &qpos, &qvel);
        let nv = model.nv();
        let vectors = [some(nv, 0.1), some(nv, 5.0)].concat();
        let roots: Vec<f64> = state.inverse_diagonal().iter().map(|inverse| inverse.sqrt()).collect();
        let mut whitened = vec![0.0; 2 * nv];
        state.whiten(&mut whitened, &vectors, &roots).expect("a factor");
        let inner = |a: &[f64], b: &[f64]| sum(a.iter().zip(b).map(|(a, b)| a * b));
        for (i, j) in [(0, 0), (0, 1), (1, 1)] {
            let of = |all: &[f64], k: usize| all[k * nv..(k + 1) * nv].to_vec();
            let mut solved = vec![0.0; nv];
            state.solve_mass(&mut solved, &of(&vectors, j)).expect("a factor");
            let (here, there) =
                (inner(&of(&whitened, i), &of(&whitened, j)), inner(&of(&vectors, i), &solved));
            assert!((here - there).abs() < 1e-12 * there.abs().max(1.0), "{i}, {j}: {here}, not {there}");
        }
    }
}
