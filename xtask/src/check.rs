//! The checks that come before the tests, cheapest first; the first failure ends them.

use std::{process::ExitCode, time::Instant};

use crate::{
    cargo::{CommandLine, Workspace},
    process::{is_installed, wait_for},
};

/// One check: what it is called, what it runs, and the program without which it is skipped.
struct Check {
    name: &'static str,
    command: CommandLine,
    needs: Option<&'static str>,
}

/// Runs every check, says how long each took, and stops at the first that fails.
pub(crate) fn run(workspace: &Workspace) -> ExitCode {
    for Check {
        name,
        command,
        needs,
    } in checks(workspace)
    {
        if let Some(program) = needs.filter(|program| !is_installed(program)) {
            eprintln!("== {name}: skipped, {program} is not installed");
            continue;
        }
        let start = Instant::now();
        let code = wait_for(&command);
        let seconds = start.elapsed().as_secs_f64();
        if code != ExitCode::SUCCESS {
            eprintln!("== {name}: failed after {seconds:.1} s");
            return code;
        }
        eprintln!("== {name}: passed in {seconds:.1} s");
    }
    ExitCode::SUCCESS
}

/// Compiling checks use the release profile, as the tests do: build scripts, procedural macros and
/// (for the documentation) the metadata of dependencies are then made once.
fn checks(workspace: &Workspace) -> Vec<Check> {
    let mut documentation = workspace.cargo("doc", &["--release", "--workspace", "--no-deps"]);
    documentation
        .environment
        .push(("RUSTDOCFLAGS", "-D warnings"));
    vec![
        Check {
            name: "formatting",
            command: workspace.cargo("fmt", &["--all", "--check"]),
            needs: None,
        },
        Check {
            name: "spelling",
            command: CommandLine::new("typos", &[]).with(&workspace.root),
            needs: Some("typos"),
        },
        Check {
            name: "licences and sources",
            command: workspace.cargo("deny", &["check"]),
            needs: Some("cargo-deny"),
        },
        Check {
            name: "lints",
            command: workspace.cargo(
                "clippy",
                &[
                    "--release",
                    "--workspace",
                    "--all-targets",
                    "--",
                    "-D",
                    "warnings",
                ],
            ),
            needs: None,
        },
        Check {
            name: "documentation",
            command: documentation,
            needs: None,
        },
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_cheapest_check_comes_first_and_only_installed_tools_are_asked() {
        let workspace = Workspace {
            root: "/ws".into(),
            cargo: "cargo".into(),
        };
        let checks = checks(&workspace);
        let names: Vec<_> = checks.iter().map(|check| check.name).collect();
        assert_eq!(
            names,
            [
                "formatting",
                "spelling",
                "licences and sources",
                "lints",
                "documentation"
            ]
        );
        for check in checks {
            let subcommand = check.command.arguments[0].to_string_lossy().into_owned();
            let comes_with_rust = ["fmt", "clippy", "doc"].contains(&subcommand.as_str());
            assert_eq!(check.needs.is_none(), comes_with_rust, "{}", check.name);
        }
    }
}
