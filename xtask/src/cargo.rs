//! The cargo command line that a task stands for.

use std::{
    env,
    ffi::{OsStr, OsString},
    path::{Path, PathBuf},
};

use crate::task::Task;

/// A program, its arguments, and what is added to its environment.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct CommandLine {
    pub(crate) program: OsString,
    pub(crate) arguments: Vec<OsString>,
    pub(crate) environment: Vec<(&'static str, &'static str)>,
}

impl CommandLine {
    /// A command line of words known in advance.
    pub(crate) fn new(program: impl Into<OsString>, arguments: &[&str]) -> Self {
        Self {
            program: program.into(),
            arguments: arguments.iter().map(OsString::from).collect(),
            environment: Vec::new(),
        }
    }

    /// With one more argument.
    pub(crate) fn with(mut self, argument: impl Into<OsString>) -> Self {
        self.arguments.push(argument.into());
        self
    }

    /// With more arguments.
    pub(crate) fn with_all<A: Into<OsString>>(
        mut self,
        arguments: impl IntoIterator<Item = A>,
    ) -> Self {
        self.arguments.extend(arguments.into_iter().map(Into::into));
        self
    }
}

/// Where the workspace is and which cargo builds it.
pub(crate) struct Workspace {
    pub(crate) root: PathBuf,
    pub(crate) cargo: OsString,
}

impl Workspace {
    /// The workspace this program belongs to, and the cargo that started it.
    ///
    /// `cargo run` says where the package is; without it, where it was when it was compiled.
    pub(crate) fn of_this_program() -> Self {
        let package = env::var_os("CARGO_MANIFEST_DIR")
            .map_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")), PathBuf::from);
        Self {
            root: package
                .parent()
                .map_or_else(|| package.clone(), Path::to_path_buf),
            cargo: env::var_os("CARGO").unwrap_or_else(|| "cargo".into()),
        }
    }

    /// `cargo SUBCOMMAND --manifest-path WORKSPACE ARGUMENTS`.
    pub(crate) fn cargo(&self, subcommand: &str, arguments: &[&str]) -> CommandLine {
        CommandLine::new(&self.cargo, &[subcommand, "--manifest-path"])
            .with(self.root.join("Cargo.toml"))
            .with_all(arguments)
    }

    /// The command line of a task that is one command, with the user's arguments.
    ///
    /// # Errors
    /// With what to say to the user, when tests are asked for on a device that has none.
    pub(crate) fn run(&self, task: Task, arguments: Vec<OsString>) -> Result<CommandLine, String> {
        if task == Task::Test
            && let Some((device, rest)) = taken_device(&arguments)
        {
            return self.test_on(&device, rest);
        }
        let program = |package, name, subcommand: &[&str]| {
            self.cargo("run", &["--release", "--package", package, "--bin", name])
                .with_all(gpu_features(&arguments))
                .with("--")
                .with_all(subcommand)
        };
        let command = match task {
            Task::Train => program("sos-train", "sos", &["train"]),
            Task::Doctor => program("sos-train", "sos", &["doctor"]),
            Task::Import => program("sos-train", "sos", &["import"]),
            Task::Export => program("sos-train", "sos", &["export"]),
            Task::Eval => program("sos-train", "sos", &["eval"]),
            Task::Compare => program("sos-train", "sos", &["compare"]),
            Task::Ablate => program("sos-train", "sos", &["ablate"]),
            Task::Results => program("sos-train", "sos", &["results"]),
            Task::Sos => program("sos-train", "sos", &[]),
            Task::Demo => program("demo-scene", "demo-scene", &[]),
            Task::Bench => program("sos-bench", "sos-bench", &[]),
            Task::Test | Task::Check | Task::Ci => self
                .cargo("test", &["--release"])
                .with_all(everywhere(&arguments)),
        };
        let mut command = command.with_all(arguments);
        if matches!(
            task,
            Task::Train
                | Task::Doctor
                | Task::Import
                | Task::Export
                | Task::Eval
                | Task::Compare
                | Task::Ablate
                | Task::Results
                | Task::Sos
        ) {
            // So that hints can be pasted: `cargo xtask train --resume`.
            command.environment.push(("SOS_INVOKED_AS", "cargo xtask"));
        }
        Ok(command)
    }
}

/// Features of the tests' package that name what GPUs are reached through.
const GPU_FEATURES: [&str; 4] = ["wgpu", "vulkan", "metal", "cuda"];
/// Names of the CPU, whose tests are the workspace's.
const CPU_NAMES: [&str; 3] = ["cpu", "flex", "ndarray"];

impl Workspace {
    /// The ops' tests on a device, which fail where they would be skipped; on the CPU all tests.
    fn test_on(&self, device: &str, rest: Vec<OsString>) -> Result<CommandLine, String> {
        if CPU_NAMES.contains(&device) {
            return self.run(Task::Test, rest);
        }
        if !GPU_FEATURES.contains(&device) {
            return Err(format!(
                "`cargo xtask test --device {device}`: choose one of {}, or cpu for all tests but those of GPUs",
                GPU_FEATURES.join(", ")
            ));
        }
        let mut command = self
            .cargo("test", &["--release", "--package", "sos-tests"])
            .with_all(["--package", "gpu-tensors", "--features", device])
            .with_all(["--test", "gpu_parity", "--lib"])
            .with_all(rest);
        command.environment.push(("SOS_REQUIRE_GPU", "1"));
        Ok(command)
    }
}

/// `--device NAME` or `--device=NAME` with the other arguments, if it comes before `--`.
fn taken_device(arguments: &[OsString]) -> Option<(String, Vec<OsString>)> {
    let own = arguments.iter().take_while(|argument| *argument != "--");
    for (i, argument) in own.enumerate() {
        let text = argument.to_string_lossy();
        let (name, used) = match text.strip_prefix("--device=") {
            Some(name) => (name.to_owned(), 1),
            None if text == "--device" => {
                let name = arguments.get(i + 1)?;
                (name.to_string_lossy().into_owned(), 2)
            }
            None => continue,
        };
        let rest = arguments[..i].iter().chain(&arguments[i + used..]);
        return Some((name, rest.cloned().collect()));
    }
    None
}

/// The features that a program needs for the device it is asked to use.
fn gpu_features(arguments: &[OsString]) -> &'static [&'static str] {
    match taken_device(arguments) {
        Some((device, _)) if device == "wgpu" => &["--features", "wgpu"],
        Some((device, _)) if device == "cuda" => &["--features", "cuda"],
        _ => &[],
    }
}

/// `--workspace`, unless the user's arguments choose packages (which it would overrule).
fn everywhere(arguments: &[OsString]) -> &'static [&'static str] {
    let chooses = |argument: &OsStr| {
        let text = argument.to_string_lossy();
        text == "--package" || text.starts_with("--package=") || is_short_package(&text)
    };
    let for_cargo = arguments.iter().take_while(|argument| *argument != "--");
    if for_cargo.into_iter().any(|argument| chooses(argument)) {
        &[]
    } else {
        &["--workspace"]
    }
}

/// `-p NAME` or `-pNAME`.
fn is_short_package(text: &str) -> bool {
    text.starts_with("-p")
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn workspace() -> Workspace {
        Workspace {
            root: "/ws".into(),
            cargo: "cargo".into(),
        }
    }

    fn line(task: Task, arguments: &[&str]) -> String {
        let command = workspace()
            .run(task, arguments.iter().map(OsString::from).collect())
            .unwrap();
        assert_eq!(command.program, "cargo");
        let words: Vec<_> = command
            .arguments
            .iter()
            .map(|word| word.to_string_lossy())
            .collect();
        words.join(" ").replace('\\', "/")
    }

    #[test]
    fn train_and_eval_run_the_program_optimised() {
        let sos = "run --manifest-path /ws/Cargo.toml --release --package sos-train --bin sos --";
        assert_eq!(line(Task::Train, &[]), format!("{sos} train"));
        assert_eq!(
            line(Task::Train, &["scene", "--masks", "m"]),
            format!("{sos} train scene --masks m")
        );
        assert_eq!(
            line(Task::Eval, &["runs/demo"]),
            format!("{sos} eval runs/demo")
        );
        assert_eq!(line(Task::Doctor, &["fox"]), format!("{sos} doctor fox"));
        assert_eq!(
            line(Task::Import, &["fox", "--out", "scene"]),
            format!("{sos} import fox --out scene")
        );
        assert_eq!(
            line(Task::Export, &["runs/demo", "--to", "glb"]),
            format!("{sos} export runs/demo --to glb")
        );
        assert_eq!(
            line(Task::Ablate, &["scene", "--rivals"]),
            format!("{sos} ablate scene --rivals")
        );
        assert_eq!(line(Task::Sos, &["--version"]), format!("{sos} --version"));
    }

    #[test]
    fn demo_passes_its_folder_on() {
        assert_eq!(
            line(Task::Demo, &["out"]),
            "run --manifest-path /ws/Cargo.toml --release --package demo-scene --bin demo-scene -- out"
        );
    }

    #[test]
    fn test_covers_the_workspace_unless_packages_are_chosen() {
        let test = "test --manifest-path /ws/Cargo.toml --release";
        assert_eq!(line(Task::Test, &[]), format!("{test} --workspace"));
        assert_eq!(
            line(Task::Test, &["alpha"]),
            format!("{test} --workspace alpha")
        );
        for choice in [&["-p", "losses"][..], &["-plosses"], &["--package=losses"]] {
            assert_eq!(
                line(Task::Test, choice),
                format!("{test} {}", choice.join(" "))
            );
        }
        // After `--` the arguments are the test program's.
        assert_eq!(
            line(Task::Test, &["--", "-p"]),
            format!("{test} --workspace -- -p")
        );
    }

    #[test]
    fn a_device_chooses_its_tests_and_its_build() {
        let test = "test --manifest-path /ws/Cargo.toml --release --package sos-tests \
                    --package gpu-tensors --features wgpu --test gpu_parity --lib";
        assert_eq!(line(Task::Test, &["--device", "wgpu"]), test);
        assert_eq!(
            line(Task::Test, &["--device=wgpu", "adam", "--", "-q"]),
            format!("{test} adam -- -q")
        );
        let arguments = ["--device", "wgpu"].map(OsString::from).to_vec();
        let command = workspace().run(Task::Test, arguments).unwrap();
        assert_eq!(command.environment, [("SOS_REQUIRE_GPU", "1")]);
        assert!(line(Task::Train, &["--device", "wgpu"]).contains(" --features wgpu -- train "));
        assert!(line(Task::Bench, &["--device", "cuda"]).contains(" --features cuda -- --device"));
        assert!(!line(Task::Train, &["--device", "cpu"]).contains("features"));
    }

    #[test]
    fn tests_on_the_cpu_are_the_workspaces_and_no_feature_is_made_up() {
        let test = "test --manifest-path /ws/Cargo.toml --release --workspace";
        for name in CPU_NAMES {
            assert_eq!(line(Task::Test, &["--device", name]), test);
        }
        assert_eq!(
            line(Task::Test, &["--device=cpu", "adam"]),
            format!("{test} adam")
        );
        for name in ["auto", "tpu", ""] {
            let arguments = ["--device", name].map(OsString::from).to_vec();
            let refusal = workspace().run(Task::Test, arguments).unwrap_err();
            assert!(
                refusal.contains("wgpu") && refusal.contains("cpu"),
                "{refusal}"
            );
        }
    }

    #[test]
    fn bench_measures_optimised_code() {
        assert_eq!(
            line(Task::Bench, &["--json"]),
            "run --manifest-path /ws/Cargo.toml --release --package sos-bench --bin sos-bench -- --json"
        );
    }

    #[test]
    fn this_program_finds_its_workspace() {
        assert!(
            Workspace::of_this_program()
                .root
                .join("xtask/src/main.rs")
                .is_file()
        );
    }
}
