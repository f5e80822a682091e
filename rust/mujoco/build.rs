//! Compiles the shim against the headers that the MuJoCo wheel carries.
//!
//! Tells unit tests where the library lies: beside the headers.
//!
//! They are looked for in `MUJOCO_INCLUDE`, then beside the package `mujoco` of the interpreter that the extension is
//! built for (`PYO3_PYTHON`, or `python3`).

use std::path::{Path, PathBuf};
use std::process::Command;
use std::{env, fs};

/// Prints the folder of the package without importing it, which would map its library.
const FIND: &str =
    "import importlib.util as util; print(*util.find_spec('mujoco').submodule_search_locations, sep='\\n')";

fn main() {
    println!("cargo::rerun-if-changed=src/shim.c");
    println!("cargo::rerun-if-changed=src/shim.h");
    println!("cargo::rerun-if-env-changed=MUJOCO_INCLUDE");
    println!("cargo::rerun-if-env-changed=PYO3_PYTHON");
    let Some(include) = include() else {
        println!(
            "cargo::error=no mujoco/mujoco.h found: expected MUJOCO_INCLUDE to name the folder that has it, or PYO3_PYTHON an \
             interpreter with the package mujoco-core"
        );
        return;
    };
    println!("cargo::rerun-if-changed={}", include.join("mujoco/mujoco.h").display());
    if let Some(library) = include.parent().and_then(library) {
        println!("cargo::rustc-env=OARLOCK_MUJOCO_LIBRARY={}", library.display());
    }
    cc::Build::new().file("src/shim.c").include(include).std("c11").warnings(true).compile("oarlock_shim");
}

fn include() -> Option<PathBuf> {
    if let Some(given) = env::var_os("MUJOCO_INCLUDE") {
        return has_header(PathBuf::from(given));
    }
    let python = env::var_os("PYO3_PYTHON").unwrap_or_else(|| "python3".into());
    let output = Command::new(python).args(["-c", FIND]).output().ok()?;
    let folders = String::from_utf8(output.stdout).ok()?;
    folders.lines().find_map(|folder| has_header(PathBuf::from(folder).join("include")))
}

fn has_header(folder: PathBuf) -> Option<PathBuf> {
    folder.join("mujoco/mujoco.h").is_file().then_some(folder)
}

/// MuJoCo's library in a folder.
fn library(folder: &Path) -> Option<PathBuf> {
    let is_library = |path: &PathBuf| {
        let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
        name.starts_with("libmujoco.") || name == "mujoco.dll"
    };
    fs::read_dir(folder).ok()?.flatten().map(|entry| entry.path()).find(is_library)
}
