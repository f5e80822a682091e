//! The target of `make fuzz`.

#![cfg_attr(fuzzing, no_main)]

#[cfg(fuzzing)]
libfuzzer_sys::fuzz_target!(|data: &[u8]| oarlock_fuzz::run(data));

/// Without the fuzzing engine: runs the files named on the command line, to see what a finding does.
#[cfg(not(fuzzing))]
fn main() -> std::io::Result<()> {
    for path in std::env::args_os().skip(1) {
        oarlock_fuzz::run(&std::fs::read(path)?);
    }
    Ok(())
}
