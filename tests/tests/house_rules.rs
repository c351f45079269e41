//! The rules of the house, as tests: which crate may know which, and how files look.
//!
//! A failure names the file and the remedy. Dependencies are those that `cargo metadata` reports;
//! everything else is read from the files.

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
    process::Command,
    sync::LazyLock,
};

use serde_json::Value;

/// What each crate may depend on within the workspace: the arrows of ARCHITECTURE.md.
const ALLOWED: [(&str, &[&str]); 19] = [
    ("draft-folder", &[]),
    ("ply-mesh", &[]),
    ("tensor-slices", &[]),
    ("gpu-tensors", &[]),
    ("hashgrid", &["gpu-tensors", "tensor-slices"]),
    ("neus-render", &["gpu-tensors", "tensor-slices"]),
    ("losses", &["gpu-tensors", "tensor-slices"]),
    (
        "scene-decomp",
        &["gpu-tensors", "hashgrid", "neus-render", "tensor-slices"],
    ),
    ("io-colmap", &[]),
    ("scene-import", &["draft-folder", "io-colmap"]),
    (
        "scene-capture",
        &["draft-folder", "io-colmap", "scene-import"],
    ),
    ("scene-doctor", &["io-colmap", "scene-capture"]),
    ("scene-export", &["draft-folder", "io-colmap", "ply-mesh"]),
    ("demo-scene", &["draft-folder", "ply-mesh"]),
    ("sos-eval", &["draft-folder", "ply-mesh"]),
    (
        "sos-train",
        &[
            "demo-scene",
            "draft-folder",
            "gpu-tensors",
            "hashgrid",
            "io-colmap",
            "losses",
            "neus-render",
            "ply-mesh",
            "scene-capture",
            "scene-decomp",
            "scene-doctor",
            "scene-export",
            "scene-import",
            "sos-eval",
            "tensor-slices",
        ],
    ),
    (
        "sos-bench",
        &[
            "demo-scene",
            "gpu-tensors",
            "hashgrid",
            "io-colmap",
            "neus-render",
            "scene-decomp",
            "sos-train",
            "tensor-slices",
        ],
    ),
    ("xtask", &[]),
    (
        "sos-tests",
        &[
            "demo-scene",
            "gpu-tensors",
            "hashgrid",
            "io-colmap",
            "losses",
            "neus-render",
            "scene-decomp",
            "scene-import",
            "sos-eval",
            "sos-train",
            "tensor-slices",
            "xtask",
        ],
    ),
];

/// What a crate's own tests may use beyond that.
const ALLOWED_IN_TESTS: [(&str, &[&str]); 2] = [
    ("scene-capture", &["demo-scene"]),
    // Reads back what is written for other tools.
    ("scene-export", &["scene-import"]),
];

/// Crates that are useful to people who do not use Burn, and quick to build without it.
const WITHOUT_BURN: [&str; 10] = [
    "draft-folder",
    "ply-mesh",
    "io-colmap",
    "scene-import",
    "scene-capture",
    "scene-doctor",
    "scene-export",
    "sos-eval",
    "demo-scene",
    "xtask",
];

/// A file is one idea; this is where it has certainly become two.
const MOST_LINES: usize = 500;

/// Names that say nothing about what is inside.
const EMPTY_NAMES: [&str; 7] = [
    "util", "utils", "common", "helper", "helpers", "misc", "manager",
];

/// Macros of unfinished work; the parenthesis is added when searching, so as not to find this list.
const UNFINISHED: [&str; 3] = ["todo!", "unimplemented!", "dbg!"];

static METADATA: LazyLock<Value> = LazyLock::new(|| {
    let output = Command::new(env!("CARGO"))
        .args(["metadata", "--format-version", "1", "--no-deps"])
        .args(["--offline", "--manifest-path"])
        .arg(root().join("Cargo.toml"))
        .output()
        .expect("cargo starts");
    let complaint = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "cargo metadata: {complaint}");
    serde_json::from_slice(&output.stdout).expect("cargo metadata prints JSON")
});

/// A crate of the workspace, as cargo reports it.
struct Package {
    name: &'static str,
    folder: PathBuf,
    report: &'static Value,
}

impl Package {
    /// The names of what it depends on, with the kind: "normal", "build" or "dev".
    fn dependencies(&self) -> impl Iterator<Item = (&'static str, &'static str)> {
        list(self.report, "dependencies").map(|dependency| {
            let kind = dependency["kind"].as_str().unwrap_or("normal");
            (text(dependency, "name"), kind)
        })
    }

    /// The root files of its library and programs.
    fn roots(&self) -> impl Iterator<Item = &'static Path> {
        list(self.report, "targets")
            .filter(|target| {
                list(target, "kind").any(|kind| ["lib", "bin"].map(Value::from).contains(kind))
            })
            .map(|target| Path::new(text(target, "src_path")))
    }

    fn is_published(&self) -> bool {
        // `publish = false` is reported as an empty list of registries.
        self.report["publish"].as_array().is_none()
    }
}

fn packages() -> Vec<Package> {
    let package = |report: &'static Value| Package {
        name: text(report, "name"),
        folder: Path::new(text(report, "manifest_path")).with_file_name(""),
        report,
    };
    list(&METADATA, "packages").map(package).collect()
}

fn text<'a>(value: &'a Value, key: &str) -> &'a str {
    value[key].as_str().unwrap_or_default()
}

fn list<'a>(value: &'a Value, key: &str) -> impl Iterator<Item = &'a Value> + use<'a> {
    value[key].as_array().into_iter().flatten()
}

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .parent()
        .expect("this package is a folder of the workspace")
}

/// A path as one reads it: from the workspace's root.
fn shown(path: &Path) -> String {
    path.strip_prefix(root())
        .unwrap_or(path)
        .display()
        .to_string()
}

fn read(path: &Path) -> String {
    fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", shown(path)))
}

/// All files below `folder` with that extension, without build outputs, runs and hidden folders.
fn files_below(folder: &Path, extension: &str) -> Vec<PathBuf> {
    let mut files = Vec::new();
    let mut folders = vec![folder.to_path_buf()];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(&folder).expect("a folder of the workspace") {
            let path = entry.expect("an entry of a folder").path();
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            if path.is_dir() {
                if !name.starts_with('.') && !["target", "runs"].contains(&&*name) {
                    folders.push(path);
                }
            } else if path.extension().is_some_and(|found| found == extension) {
                files.push(path);
            }
        }
    }
    files.sort();
    files
}

fn rust_files() -> Vec<PathBuf> {
    let files: Vec<_> = packages()
        .iter()
        .flat_map(|package| files_below(&package.folder, "rs"))
        .collect();
    assert!(files.len() > ALLOWED.len(), "the walk finds the sources");
    files
}

/// Fails with all violations at once, one a line.
fn assert_none(violations: &[String]) {
    assert!(violations.is_empty(), "\n  {}\n", violations.join("\n  "));
}

#[test]
fn crates_depend_on_each_other_only_as_drawn() {
    let allowed: BTreeMap<_, _> = ALLOWED.into();
    let allowed_in_tests: BTreeMap<_, _> = ALLOWED_IN_TESTS.into();
    let mut violations = Vec::new();
    for package in packages() {
        let name = package.name;
        let Some(normal) = allowed.get(name) else {
            violations.push(format!(
                "{name}/Cargo.toml: a crate unknown to the rules; draw it in ARCHITECTURE.md and \
                 add it to ALLOWED in tests/tests/house_rules.rs"
            ));
            continue;
        };
        for (dependency, kind) in package.dependencies() {
            let in_tests = kind == "dev"
                && allowed_in_tests
                    .get(name)
                    .is_some_and(|more| more.contains(&dependency));
            let inside = allowed.contains_key(dependency);
            if inside && !normal.contains(&dependency) && !in_tests {
                violations.push(format!(
                    "{name}/Cargo.toml: must not depend on {dependency} ({kind}); let them meet in \
                     a crate that may know both, or in sos-tests if it is for a test"
                ));
            }
        }
    }
    assert_none(&violations);
}

#[test]
fn crates_for_everyone_do_not_need_burn() {
    let mut violations = Vec::new();
    for package in packages() {
        for (dependency, kind) in package.dependencies() {
            if WITHOUT_BURN.contains(&package.name) && dependency.starts_with("burn") {
                violations.push(format!(
                    "{}/Cargo.toml: must not depend on {dependency} ({kind}); take slices or \
                     images instead of tensors",
                    package.name
                ));
            }
        }
    }
    assert_none(&violations);
}

#[test]
fn every_manifest_inherits_the_lints_of_the_workspace() {
    let mut violations = Vec::new();
    for package in packages() {
        let manifest = package.folder.join("Cargo.toml");
        let lines: Vec<String> = read(&manifest)
            .lines()
            .map(|line| line.replace(' ', ""))
            .collect();
        let as_table = lines
            .windows(2)
            .any(|pair| pair[0] == "[lints]" && pair[1] == "workspace=true");
        if !as_table && !lines.iter().any(|line| line == "lints.workspace=true") {
            violations.push(format!(
                "{}: add\n    [lints]\n    workspace = true",
                shown(&manifest)
            ));
        }
    }
    assert_none(&violations);
}

#[test]
fn every_crate_says_what_it_is() {
    let mut violations = Vec::new();
    for package in packages() {
        let name = package.name;
        if text(package.report, "description").len() < 20 {
            violations.push(format!(
                "{name}/Cargo.toml: describe the crate in one sentence"
            ));
        }
        if package.is_published() && !package.folder.join("README.md").is_file() {
            violations.push(format!(
                "{name}: add a README.md, which its page on crates.io shows"
            ));
        }
        for file in package.roots() {
            if !read(file).starts_with("//!") {
                violations.push(format!(
                    "{}: begin with `//!` and the story of the crate",
                    shown(file)
                ));
            }
        }
    }
    assert_none(&violations);
}

#[test]
fn published_crates_have_metadata_and_an_example() {
    let mut violations = Vec::new();
    for package in packages().iter().filter(|package| package.is_published()) {
        let (name, report) = (package.name, package.report);
        for key in ["license", "readme", "repository", "rust_version"] {
            if text(report, key).is_empty() {
                violations.push(format!("{name}/Cargo.toml: say `{key}`"));
            }
        }
        for key in ["keywords", "categories"] {
            if !(1..=5).contains(&list(report, key).count()) {
                violations.push(format!("{name}/Cargo.toml: name 1 to 5 {key}"));
            }
        }
        for keyword in list(report, "keywords").filter_map(Value::as_str) {
            if keyword.len() > 20 {
                violations.push(format!(
                    "{name}/Cargo.toml: crates.io takes keywords of 20 letters, not `{keyword}`"
                ));
            }
        }
        let is_example = |target: &Value| list(target, "kind").any(|kind| kind == "example");
        if !list(report, "targets").any(is_example) {
            violations.push(format!(
                "{name}: add an example, and a line about it to docs/reuse.md"
            ));
        }
    }
    assert_none(&violations);
}

#[test]
fn a_file_is_one_idea() {
    let mut violations = Vec::new();
    for file in rust_files() {
        let lines = read(&file).lines().count();
        if lines > MOST_LINES {
            violations.push(format!(
                "{}: {lines} lines, at most {MOST_LINES}; split it by idea",
                shown(&file)
            ));
        }
    }
    assert_none(&violations);
}

#[test]
fn names_say_what_is_inside() {
    let mut violations = Vec::new();
    for file in rust_files() {
        let inside = file.strip_prefix(root()).unwrap_or(&file);
        let words = inside
            .components()
            .map(|word| Path::new(word.as_os_str()).file_stem());
        let empty = |word: &std::ffi::OsStr| EMPTY_NAMES.iter().any(|name| word == *name);
        if words.flatten().any(empty) {
            violations.push(format!(
                "{}: name it after what it does, not after being of use",
                shown(&file)
            ));
        }
    }
    assert_none(&violations);
}

#[test]
fn nothing_unfinished_is_left() {
    let mut violations = Vec::new();
    for file in rust_files() {
        for (index, line) in read(&file).lines().enumerate() {
            for name in UNFINISHED {
                if line.contains(&format!("{name}(")) {
                    violations.push(format!(
                        "{}:{}: finish or remove `{name}`",
                        shown(&file),
                        index + 1
                    ));
                }
            }
        }
    }
    assert_none(&violations);
}

#[test]
fn links_in_documents_lead_somewhere() {
    let mut violations = Vec::new();
    for document in files_below(root(), "md") {
        for (line, link) in links(&read(&document)) {
            let path = link.split('#').next().unwrap_or_default();
            let elsewhere = ["http://", "https://", "mailto:"];
            if path.is_empty() || elsewhere.iter().any(|start| path.starts_with(start)) {
                continue;
            }
            if !document.with_file_name(path).exists() {
                violations.push(format!(
                    "{}:{line}: links to `{path}`, which does not exist; correct or remove it",
                    shown(&document)
                ));
            }
        }
    }
    assert_none(&violations);
}

/// The targets of a document's `[text](target)` links, outside code, with their line numbers.
fn links(document: &str) -> Vec<(usize, &str)> {
    let mut links = Vec::new();
    let mut in_code = false;
    for (index, line) in document.lines().enumerate() {
        if line.trim_start().starts_with("```") {
            in_code = !in_code;
        }
        if in_code {
            continue;
        }
        // Every other piece between backticks is code.
        for prose in line.split('`').step_by(2) {
            for part in prose.split("](").skip(1) {
                links.extend(part.split_once(')').map(|(link, _)| (index + 1, link)));
            }
        }
    }
    links
}

#[test]
fn links_are_found_in_prose_only() {
    let document = "see [one](a.md#part) and [two](b.md)\n```\n[no](c.md)\n```\n`v[i](j)` [d](e/)";
    assert_eq!(links(document), [(1, "a.md#part"), (1, "b.md"), (5, "e/")]);
}
