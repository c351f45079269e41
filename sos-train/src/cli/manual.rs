//! `sos completions` and `sos man`: what shells and manual readers want, made from the command line's
//! own description.

use super::Sos;
use super::answer::{answer, print};
use crate::error::EXIT_CODES;
use crate::run_folder::{RunError, write_whole};
use clap::{Command, CommandFactory as _};
use clap_complete::{Shell, generate};
use clap_mangen::Man;
use clap_mangen::roff::{Roff, bold, roman};
use std::io;
use std::path::Path;

/// The program's name in a shell.
const NAME: &str = "sos";

/// Which value of a setting is taken.
const ORDER: &str = "Later ones win: the defaults, then a preset (--preset, or the one that a file names), \
then the run's own config.toml with --resume or another one with --config, then --steps, --seed, --device \
and --downscale, then every --set key=value in turn. A file need not name every key; the config.toml of \
any run has them all.";

/// Prints the script for a shell.
pub(super) fn completions(shell: Shell) -> anyhow::Result<()> {
    let mut script = Vec::new();
    generate(shell, &mut Sos::command(), NAME, &mut script);
    Ok(print(&script)?)
}

/// Prints the program's page, or writes those of all commands into a folder.
pub(super) fn pages(out: Option<&Path>) -> anyhow::Result<()> {
    let mut command = Sos::command();
    // So that the names of commands have the program's before them.
    command.build();
    let Some(dir) = out else {
        return Ok(print(&page(command)?)?);
    };
    let mut count = 1;
    write_page(dir, NAME, command.clone())?;
    for sub in command
        .get_subcommands()
        .filter(|sub| sub.get_name() != "help")
    {
        let name = format!("{NAME}-{}", sub.get_name());
        write_page(dir, &name, sub.clone())?;
        count += 1;
    }
    Ok(answer(&format!("{}: {count} manual pages", dir.display()))?)
}

fn write_page(dir: &Path, name: &str, command: Command) -> anyhow::Result<()> {
    let path = dir.join(format!("{name}.1"));
    // clap keeps names for as long as the program runs.
    let name: &'static str = name.to_owned().leak();
    write_whole(&path, &page(command.name(name))?)?;
    Ok(())
}

fn page(command: Command) -> Result<Vec<u8>, RunError> {
    let has_settings = command.get_arguments().any(|arg| arg.get_id() == "set");
    let mut page = Vec::new();
    let rendered = Man::new(command).render(&mut page).and_then(|()| {
        if has_settings {
            section(&mut page, "SETTINGS", &[("", ORDER)])?;
        }
        let codes = EXIT_CODES.map(|(code, what)| (code.to_string(), what));
        let codes: Vec<(&str, &str)> = codes.iter().map(|(code, what)| (&**code, *what)).collect();
        section(&mut page, "EXIT STATUS", &codes)
    });
    rendered.map_err(|source| RunError::Io {
        action: "make",
        path: "the manual page".into(),
        source,
    })?;
    Ok(page)
}

/// A section of paragraphs, each below its tag if it has one.
fn section(page: &mut Vec<u8>, title: &str, parts: &[(&str, &str)]) -> io::Result<()> {
    let mut roff = Roff::new();
    roff.control("SH", [title]);
    for (tag, text) in parts {
        if !tag.is_empty() {
            roff.control("TP", []).text([bold(*tag)]);
        }
        roff.text([roman(*text)]);
    }
    roff.to_writer(page)
}
