//! The tests of the crate through its public face: one program, because every one of them would be linked anew.

mod bad_input;
mod blocks;
mod claims;
mod claims_boat;
mod every_solver;
mod fold;
mod frozen_counts;
mod inequalities;
mod inequalities_random;
mod narrow;
mod near_the_cut;
mod options;
mod oracle;
mod pinv;
mod pinv_tracked;
mod sequences;
mod singular;
mod sparse;
mod sr1;
mod sr1_carried;
mod support;
mod system;
