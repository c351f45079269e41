//! Completions for shells, and manual pages.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

fn sos(dir: &Path, arguments: &[&str]) -> Output {
    let output = Command::new(env!("CARGO_BIN_EXE_sos"))
        .args(arguments)
        .current_dir(dir)
        .output();
    output.unwrap()
}

#[test]
fn every_shell_gets_a_script_that_knows_commands_and_options() {
    let dir = tempfile::tempdir().unwrap();
    for shell in ["bash", "zsh", "fish", "elvish", "powershell"] {
        let output = sos(dir.path(), &["completions", shell]);
        assert_eq!(output.status.code(), Some(0), "{shell}");
        let script = String::from_utf8(output.stdout).unwrap();
        for word in ["doctor", "train", "masks", "preset"] {
            assert!(script.contains(word), "{shell}: no {word}");
        }
    }
    assert_eq!(
        sos(dir.path(), &["completions", "abacus"]).status.code(),
        Some(2)
    );
    // The shell itself has the last word on its syntax.
    let script = sos(dir.path(), &["completions", "bash"]).stdout;
    fs::write(dir.path().join("sos.bash"), script).unwrap();
    if let Ok(status) = Command::new("bash")
        .args(["-n", "sos.bash"])
        .current_dir(dir.path())
        .status()
    {
        assert!(status.success());
    }
}

#[test]
fn manual_pages_are_printed_and_written_for_every_command() {
    let dir = tempfile::tempdir().unwrap();
    let page = String::from_utf8(sos(dir.path(), &["man"]).stdout).unwrap();
    assert!(page.contains(".TH sos 1"), "{page}");
    assert!(page.contains("sos\\-doctor(1)"), "{page}");
    let output = sos(dir.path(), &["man", "--out", "man1"]);
    assert_eq!(output.status.code(), Some(0));
    for command in [
        "sos",
        "sos-train",
        "sos-doctor",
        "sos-export",
        "sos-completions",
    ] {
        let page = fs::read_to_string(dir.path().join(format!("man1/{command}.1"))).unwrap();
        assert!(page.contains(&format!(".TH {command} 1")), "{page}");
    }
    let page = fs::read_to_string(dir.path().join("man1/sos-train.1")).unwrap();
    assert!(page.contains("skip\\-checks"), "{page}");
    for part in [".SH SETTINGS", ".SH \"EXIT STATUS\"", "\\fB130\\fR"] {
        assert!(page.contains(part), "no {part} in {page}");
    }
}
