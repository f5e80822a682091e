//! Compiles the shim. It needs no headers of MuJoCo's: layouts/ has what it has to know of every version.

fn main() {
    for file in ["src/shim.c", "src/shim.h", "layouts/fields.h", "layouts/functions.h", "layouts/table.h"] {
        println!("cargo::rerun-if-changed={file}");
    }
    cc::Build::new().file("src/shim.c").std("c11").warnings(true).compile("oarlock_shim");
}
