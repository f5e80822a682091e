//! The table of [`oarlock_core::bench`] as text: ns a solve, and the ratio to the fastest pseudo-inverse of a library. Run
//! with `make bench`; `oarlock bench` prints the same.
#![allow(clippy::print_stdout)]

use oarlock_core::bench::{SIZES, Timing, compare};

const ROUNDS: usize = 9;

fn main() {
    let only: Vec<usize> = std::env::args().skip(1).filter_map(|a| a.parse().ok()).collect();
    for n in SIZES.into_iter().filter(|n| only.is_empty() || only.contains(n)) {
        let table = compare(n, ROUNDS, || false).expect("a good size");
        let reference = |of: fn(&Timing) -> f64| {
            table.iter().filter(|row| row.library && row.is_right()).map(of).fold(f64::INFINITY, f64::min)
        };
        let (solve, given) = (reference(|row| row.solve_ns), reference(|row| row.given_ns));
        println!("n = {n}");
        for row in &table {
            println!(
                "  {:<28} {:>10.0} ns {:>7.3}   given A {:>10.0} ns {:>7.3}   error {:.1e} {:.1e}   products {:.1}",
                row.name,
                row.solve_ns,
                row.solve_ns / solve,
                row.given_ns,
                row.given_ns / given,
                row.min_norm_error,
                row.contradicted_error,
                row.products
            );
        }
    }
}
