//! What the documents say about the program holds.

use clap::Parser as _;
use std::fs;
use std::path::{Path, PathBuf};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// The program's own documents: at the top, in `docs/` and below, and of the crate that is the program.
fn documents() -> Vec<PathBuf> {
    let mut found = vec![
        root().join("README.md"),
        root().join("sos-train/README.md"),
        root().join("scene-capture/README.md"),
    ];
    let mut folders = vec![root().join("docs")];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(&folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|ending| ending == "md") {
                found.push(path);
            }
        }
    }
    found
}

#[test]
fn documented_commands_are_understood() {
    let mut count = 0;
    for path in documents() {
        let document = fs::read_to_string(&path).unwrap();
        let blocks = document.split("```").skip(1).step_by(2);
        for line in blocks.flat_map(str::lines) {
            // Neither comments nor where the shell sends the output.
            let command = line
                .split(['#', '>', '|'])
                .next()
                .unwrap_or_default()
                .trim();
            let words = match command.strip_prefix("cargo xtask sos ") {
                Some(arguments) => format!("sos {arguments}"),
                None => command.to_owned(),
            };
            if !words.starts_with("sos ") {
                continue;
            }
            count += 1;
            let parsed = sos_train::cli::Sos::try_parse_from(words.split_whitespace());
            if let Err(error) = parsed {
                panic!("{}: {command}: {error}", path.display());
            }
        }
    }
    assert!(count > 50, "{count}");
}

#[test]
fn every_format_has_a_page_and_the_index_leads_to_it() {
    let docs = root().join("docs");
    let inputs = scene_import::Format::ALL.map(scene_import::Format::name);
    let masks = scene_export::MaskTool::ALL.map(|tool| format!("masks-{}", tool.name()));
    let pages = inputs
        .iter()
        .map(|name| ("formats-in.md", format!("formats/in/{name}.md")))
        .chain(
            masks
                .iter()
                .map(|name| ("formats-out.md", format!("formats/out/{name}.md"))),
        );
    for (index, page) in pages {
        let index = fs::read_to_string(docs.join(index)).unwrap();
        assert!(docs.join(&page).is_file(), "docs/{page} is missing");
        assert!(
            index.contains(&format!("]({page})")),
            "nothing leads to {page}"
        );
    }
    // Several results share a page.
    let index = fs::read_to_string(docs.join("formats-out.md")).unwrap();
    for target in scene_export::Target::ALL {
        assert!(
            index.contains(&format!("\n| `{}` |", target.name())),
            "{target:?}"
        );
    }
}

#[test]
fn every_exit_code_is_documented() {
    let readme = fs::read_to_string(root().join("sos-train/README.md")).unwrap();
    for (code, what) in sos_train::error::EXIT_CODES {
        let line = readme
            .lines()
            .find(|line| line.starts_with(&format!("| {code} |")))
            .unwrap_or_default();
        assert!(
            line.replace('`', "").contains(what),
            "{code}: {what}: {line}"
        );
    }
}
