//! A few thousand random scripts, the same every time: what `make fuzz` plays, so that it never rots.

use oarlock_fuzz::run;

/// Enough to meet every kind of action many times, in a few seconds.
const SCRIPTS: u64 = 2000;
/// Longer than most scripts need.
const BYTES: usize = 400;

#[test]
fn random_scripts_break_nothing() {
    // xorshift64*, for bytes that are the same everywhere.
    let mut state = 0x9E37_79B9_7F4A_7C15_u64;
    let mut byte = || {
        state ^= state >> 12;
        state ^= state << 25;
        state ^= state >> 27;
        state.wrapping_mul(0x2545_F491_4F6C_DD1D).to_be_bytes()[0]
    };
    for _ in 0..SCRIPTS {
        run(&(0..BYTES).map(|_| byte()).collect::<Vec<_>>());
    }
}
