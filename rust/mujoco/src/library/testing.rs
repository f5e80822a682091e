//! Models for unit tests, compiled from MJCF by the library of the package `mujoco` of an interpreter: that which the
//! extension is built for (`PYO3_PYTHON`), or `python3`.

use std::ffi::{CStr, CString, c_char, c_int, c_void};
use std::process::Command;
use std::sync::{Arc, OnceLock};
use std::{env, ptr};

use super::{Data, Model, open};

/// Prints the path of the library, without importing the package, which would map it.
const FIND: &str = "import importlib.util as util, pathlib
for folder in util.find_spec('mujoco').submodule_search_locations:
    for path in pathlib.Path(folder).glob('libmujoco*'): print(path)";

const RTLD_NOW: c_int = 2;
const MESSAGE: usize = 1000;

unsafe extern "C" {
    fn dlopen(path: *const c_char, flags: c_int) -> *mut c_void;
    fn dlsym(library: *mut c_void, name: *const c_char) -> *mut c_void;
}

type Parse = extern "C" fn(*const c_char, *const c_void, *mut c_char, c_int) -> *mut c_void;
type Compile = extern "C" fn(*mut c_void, *const c_void) -> *mut c_void;
type Delete = extern "C" fn(*mut c_void);

/// What the shim has no use for.
struct Compiler {
    parse: Parse,
    compile: Compile,
    delete_spec: Delete,
    delete_model: Delete,
}

/// Where the library is.
fn library() -> String {
    let python = env::var_os("PYO3_PYTHON").unwrap_or_else(|| "python3".into());
    let output = Command::new(&python).args(["-c", FIND]).output().expect("an interpreter");
    let printed = String::from_utf8(output.stdout).expect("a path in UTF-8");
    printed.lines().next().unwrap_or_else(|| panic!("{} has no package mujoco", python.display())).to_owned()
}

/// Loads the library once, as `import mujoco` would.
fn compiler() -> &'static Compiler {
    static COMPILER: OnceLock<Compiler> = OnceLock::new();
    COMPILER.get_or_init(|| {
        let path = library();
        let name = CString::new(path.as_str()).expect("a path without zeros");
        // SAFETY: a library of C; its initialisers ask for nothing.
        let library = unsafe { dlopen(name.as_ptr(), RTLD_NOW) };
        assert!(!library.is_null(), "{path} cannot be loaded");
        open(&path).expect("a version whose layout is known");
        let find = |name: &CStr| {
            // SAFETY: the library is never closed.
            let found = unsafe { dlsym(library, name.as_ptr()) };
            assert!(!found.is_null(), "{path} has no {name:?}");
            found
        };
        // SAFETY: the types are those of mujoco.h.
        unsafe {
            Compiler {
                parse: std::mem::transmute::<*mut c_void, Parse>(find(c"mj_parseXMLString")),
                compile: std::mem::transmute::<*mut c_void, Compile>(find(c"mj_compile")),
                delete_spec: std::mem::transmute::<*mut c_void, Delete>(find(c"mj_deleteSpec")),
                delete_model: std::mem::transmute::<*mut c_void, Delete>(find(c"mj_deleteModel")),
            }
        }
    })
}

/// The model of an MJCF text.
///
/// # Panics
/// If MuJoCo does not take it.
#[track_caller]
pub(crate) fn model(mjcf: &str) -> Arc<Model> {
    let compiler = compiler();
    let text = CString::new(mjcf).expect("a text without zeros");
    let mut message = [0_u8; MESSAGE];
    let size = c_int::try_from(MESSAGE).expect("small");
    let spec = (compiler.parse)(text.as_ptr(), ptr::null(), message.as_mut_ptr().cast(), size);
    assert!(!spec.is_null(), "{:?} in {mjcf}", CStr::from_bytes_until_nul(&message));
    let compiled = (compiler.compile)(spec, ptr::null());
    assert!(!compiled.is_null(), "no model of {mjcf}");
    // SAFETY: it was just made by the library that is open.
    let copy = unsafe { Model::copy_of(compiled as usize) };
    (compiler.delete_model)(compiled);
    (compiler.delete_spec)(spec);
    Arc::new(copy.expect("a model without plugins"))
}

/// A data at a pose (nq) with velocities (nv), all but the constraint solver done.
pub(crate) fn data(model: &Arc<Model>, qpos: &[f64], qvel: &[f64]) -> Data {
    let mut data = Data::new(model).expect("memory");
    data.qpos_mut().copy_from_slice(qpos);
    data.qvel_mut().copy_from_slice(qvel);
    data.smooth_stages().expect("a state");
    data
}

/// The pose (nq) that velocities (nv), kept up for so long (s), lead to: q̈ = 0 on the way.
pub(crate) fn moved(model: &Model, qpos: &[f64], qvel: &[f64], time: f64) -> Vec<f64> {
    let mut moved = qpos.to_vec();
    model.integrate(&mut moved, qvel, time);
    moved
}

/// Some numbers in (−1, 1), other ones for another `seed`.
pub(crate) fn some(count: usize, seed: f64) -> Vec<f64> {
    (0..count).map(|i| (1.7 * i as f64 + seed).sin()).collect()
}

/// A pose and velocities with nothing special about them.
pub(crate) fn somewhere(model: &Model) -> (Vec<f64>, Vec<f64>) {
    let pose = moved(model, model.qpos0(), &some(model.nv(), 0.3), 0.4);
    (pose, some(model.nv(), 2.0))
}

/// A bob of 2 kg on two slides, held by a rope of 1.5 m from the origin: x and z are relative to its place below.
pub(crate) const PENDULUM: &str = r#"<mujoco>
  <option timestep="1e-3" integrator="RK4"><flag contact="disable"/></option>
  <worldbody>
    <site name="hook"/>
    <body pos="0 0 -1.5">
      <joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/>
      <geom size=".1" mass="2"/><site name="bob"/>
    </body>
  </worldbody>
  <tendon><spatial name="rope"><site site="hook"/><site site="bob"/></spatial></tendon>
  <equality><tendon tendon1="rope"/></equality>
</mujoco>"#;

/// Length of its rope at rest, m.
pub(crate) const LENGTH: f64 = 1.5;
