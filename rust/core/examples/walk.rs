//! A solver carried along a walk: how many iterations each step costs, once the first has been paid.
//!
//! ```sh
//! cargo run -p oarlock-core --release --example walk
//! ```
//!
//! The rowing boat of the paper at steps of 1 ms: six rows of rank four, whose null space turns with the oars. `sr1-tracked`
//! begins with an eigendecomposition and then carries A⁺ and a basis of the null space from step to step.
#![allow(clippy::print_stdout)]

use oarlock_core::test_problems::{ROWS, boat};
use oarlock_core::{ConstrainedSystem, Error, Options, Wanted, make_solver};

const TIMESTEP: f64 = 1e-3;
const STEPS: u32 = 2000;
/// Steps between two lines.
const SHOWN: u32 = 200;

fn main() -> Result<(), Error> {
    let options = Options::new().with("rtol", 1e-8);
    let mut tracked = make_solver("sr1-tracked", &options)?;
    let mut reference = make_solver("pinv", &Options::new())?;
    let (mut system, mut x, mut least) = (ConstrainedSystem::new(), [0.0; ROWS], [0.0; ROWS]);
    let (mut iterations, mut products) = (0, 0);
    println!("time, s  iterations  products  anew  rank  from the minimum norm");
    for step in 1..=STEPS {
        let time = TIMESTEP * f64::from(step);
        system.assemble(&boat(time).view())?;
        let info = system.solve(&mut *tracked, Wanted::Multipliers, &mut x)?;
        iterations += info.iterations;
        products += info.products;
        if step == 1 || step % SHOWN == 0 {
            system.solve(&mut *reference, Wanted::Multipliers, &mut least)?;
            let gap = x.iter().zip(&least).map(|(x, least)| (x - least).powi(2)).sum::<f64>().sqrt();
            println!(
                "{time:7.3}  {:10}  {:8}  {:4}  {:4}  {gap:.1e}",
                info.iterations,
                info.products,
                if info.refreshed { "yes" } else { "no" },
                info.rank.unwrap_or_default(),
            );
        }
    }
    let each = |count: usize| count as f64 / f64::from(STEPS);
    println!("mean: {:.2} iterations and {:.2} products a step", each(iterations), each(products));
    Ok(())
}
