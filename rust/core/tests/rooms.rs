//! The rooms of the crate import downwards only, and no file needs itself by way of others.
//!
//! Reads the `use` declarations of `src/` as text; unit tests and documentation may look anywhere.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

/// The floors, top to bottom. Rooms on one floor do not know each other.
const FLOORS: [&[&str]; 8] = [
    &["bench"],
    &["test_problems"],
    &["inequalities"],
    &["registry", "system"],
    &["solvers"],
    &["problem"],
    &["linalg"],
    &["error", "info", "params"],
];

/// The front door, which shows every room and which nobody inside goes through; the ground floor is one room.
const FACADE: &str = "lib";

/// Module path of every file, such as `solvers::eigen::carried`, and its source without its unit tests.
fn files() -> BTreeMap<String, String> {
    fn walk(folder: &Path, found: &mut Vec<PathBuf>) {
        for entry in fs::read_dir(folder).expect("a folder of sources") {
            let path = entry.expect("an entry of it").path();
            if path.is_dir() {
                walk(&path, found);
            } else if path.extension().is_some_and(|extension| extension == "rs") {
                found.push(path);
            }
        }
    }
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut found = Vec::new();
    walk(&root, &mut found);
    let module = |path: &Path| {
        let relative = path.strip_prefix(&root).expect("below src").with_extension("");
        relative.iter().map(|part| part.to_str().expect("ASCII")).collect::<Vec<_>>().join("::")
    };
    let source = |path: &Path| {
        let text = fs::read_to_string(path).expect("UTF-8");
        text.split("#[cfg(test)]\nmod tests").next().unwrap_or_default().to_owned()
    };
    found.iter().map(|path| (module(path), source(path))).collect()
}

/// The paths that a source imports, groups taken apart: `a::{b, c::d}` is `a::b` and `a::c::d`.
fn imports(source: &str) -> Vec<String> {
    fn expand(prefix: &str, tree: &str, paths: &mut Vec<String>) {
        let tree = tree.trim();
        let Some(open) = tree.find('{') else {
            let path = tree.split(" as ").next().unwrap_or(tree);
            paths.push(format!("{prefix}{path}"));
            return;
        };
        let prefix = format!("{prefix}{}", &tree[..open]);
        let (mut depth, mut start) = (0, open + 1);
        for (at, character) in tree.char_indices().skip_while(|&(at, _)| at <= open) {
            match character {
                '{' => depth += 1,
                '}' if depth > 0 => depth -= 1,
                ',' | '}' if depth == 0 => {
                    if !tree[start..at].trim().is_empty() {
                        expand(&prefix, &tree[start..at], paths);
                    }
                    start = at + 1;
                }
                _ => {}
            }
        }
    }
    let mut paths = Vec::new();
    let mut open: Option<String> = None;
    for line in source.lines() {
        let line = line.split("//").next().unwrap_or_default().trim();
        let begins = ["use ", "pub use ", "pub(crate) use ", "pub(super) use "];
        if let Some(rest) = begins.iter().find_map(|begin| line.strip_prefix(begin)) {
            open = Some(rest.to_owned());
        } else if let Some(text) = &mut open {
            text.push(' ');
            text.push_str(line);
        }
        if let Some(text) = open.take_if(|text| text.ends_with(';')) {
            expand("", text.trim_end_matches(';'), &mut paths);
        } else if open.is_none() {
            // A path written out where it is used.
            let ends = |character: char| !character.is_alphanumeric() && !"_:".contains(character);
            let written = line.split("crate::").skip(1).filter_map(|rest| rest.split(ends).next());
            paths.extend(written.map(|path| format!("crate::{path}")));
        }
    }
    paths
}

/// The file that a path imported by `module` leads into; `None` where it is another crate's, or the file itself.
fn target(module: &str, path: &str, files: &BTreeMap<String, String>) -> Option<String> {
    let mut parts = path.split("::").peekable();
    let own: Vec<&str> = module.split("::").filter(|part| *part != FACADE).collect();
    let mut at: Vec<&str> = match parts.peek() {
        Some(&"crate") => Vec::new(),
        Some(&("super" | "self")) => own,
        // `use carried::CarriedEigen` of a child.
        Some(first) if files.contains_key(&[own.as_slice(), &[*first]].concat().join("::")) => own,
        _ => return None,
    };
    for part in parts {
        match part {
            "crate" | "self" => {}
            "super" => drop(at.pop()),
            part => at.push(part),
        }
    }
    while !at.is_empty() && !files.contains_key(&at.join("::")) {
        at.pop();
    }
    let file = if at.is_empty() { FACADE.to_owned() } else { at.join("::") };
    (file != module).then_some(file)
}

/// Which files each file imports from.
fn arrows(files: &BTreeMap<String, String>) -> BTreeMap<&str, BTreeSet<String>> {
    let of = |module: &str, source: &str| {
        imports(source).iter().filter_map(|path| target(module, path, files)).collect()
    };
    files.iter().map(|(module, source)| (module.as_str(), of(module, source))).collect()
}

/// The room of a file: its folder, or the file itself.
fn room(module: &str) -> &str {
    module.split("::").next().unwrap_or(module)
}

fn floor(room: &str) -> Option<usize> {
    FLOORS.iter().position(|floor| floor.contains(&room))
}

#[test]
fn every_file_is_in_a_room_and_every_room_has_a_file() {
    let files = files();
    let rooms: BTreeSet<&str> =
        files.keys().map(|module| room(module)).filter(|&room| room != FACADE).collect();
    let named: BTreeSet<&str> = FLOORS.iter().copied().flatten().copied().collect();
    assert_eq!(rooms, named, "a room that FLOORS does not name, or one that is gone");
}

#[test]
fn rooms_import_downwards_only() {
    let files = files();
    let arrows = arrows(&files);
    assert!(
        arrows.values().map(BTreeSet::len).sum::<usize>() > 100,
        "imports are no longer found: {arrows:?}"
    );
    let ground = FLOORS.len() - 1;
    for (from, to) in
        arrows.iter().filter(|(from, _)| **from != FACADE).flat_map(|(f, t)| t.iter().map(move |t| (f, t)))
    {
        let (above, below) = (floor(room(from)), floor(room(to)));
        let same = room(from) == room(to) || (above, below) == (Some(ground), Some(ground));
        assert!(same || above.zip(below).is_some_and(|(above, below)| above < below), "{from} imports {to}");
    }
}

#[test]
fn no_file_needs_itself_by_way_of_others() {
    let files = files();
    let mut arrows = arrows(&files);
    // Takes out files that import nothing that is left, again and again: what stays stands in a circle, or above one.
    loop {
        let free: Vec<&str> = arrows.iter().filter(|(_, to)| to.is_empty()).map(|(&from, _)| from).collect();
        if free.is_empty() {
            break;
        }
        arrows.retain(|from, _| !free.contains(from));
        for to in arrows.values_mut() {
            to.retain(|to| !free.contains(&to.as_str()));
        }
    }
    assert!(arrows.is_empty(), "these import each other in a circle, or one that does: {arrows:?}");
}

#[test]
fn imports_are_read_as_the_compiler_reads_them() {
    let source = "use std::mem;\npub use carried::{A, b::{C, D as E}};\nuse super::super::problem::{\n    Needs,\n    fold::Fold,\n};\nlet x = crate::info::Info::new(); // crate::error\n";
    let expected = [
        "std::mem",
        "carried::A",
        "carried::b::C",
        "carried::b::D",
        "super::super::problem::Needs",
        "super::super::problem::fold::Fold",
        "crate::info::Info::new",
    ];
    assert_eq!(imports(source), expected);
    let files: BTreeMap<String, String> =
        ["lib", "problem", "problem::fold", "solvers", "solvers::eigen", "solvers::eigen::carried"]
            .map(|module| (module.to_owned(), String::new()))
            .into();
    let lead = |path: &str| target("solvers::eigen", path, &files);
    assert_eq!(lead("std::mem"), None);
    assert_eq!(lead("carried::A").as_deref(), Some("solvers::eigen::carried"));
    assert_eq!(lead("super::super::problem::fold::Fold").as_deref(), Some("problem::fold"));
    assert_eq!(lead("crate::problem::Needs").as_deref(), Some("problem"));
    assert_eq!(lead("crate::Error").as_deref(), Some("lib"));
    assert_eq!(lead("self::RANK_CUT"), None);
}
