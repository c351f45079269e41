//! `sos completions` and `sos man`: what shells and manual readers want, made from the command line's
//! own description.

use super::Sos;
use crate::run_folder::{RunError, write_whole};
use clap::{Command, CommandFactory as _};
use clap_complete::{Shell, generate};
use clap_mangen::Man;
use std::io::Write as _;
use std::path::Path;

/// The program's name in a shell.
const NAME: &str = "sos";

/// Prints the script for a shell.
pub(super) fn completions(shell: Shell) -> anyhow::Result<()> {
    let mut script = Vec::new();
    generate(shell, &mut Sos::command(), NAME, &mut script);
    print(&script);
    Ok(())
}

/// Prints the program's page, or writes those of all commands into a folder.
pub(super) fn pages(out: Option<&Path>) -> anyhow::Result<()> {
    let mut command = Sos::command();
    // So that the names of commands have the program's before them.
    command.build();
    let Some(dir) = out else {
        print(&page(command)?);
        return Ok(());
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
    super::answer(&format!("{}: {count} manual pages", dir.display()));
    Ok(())
}

fn write_page(dir: &Path, name: &str, command: Command) -> anyhow::Result<()> {
    let path = dir.join(format!("{name}.1"));
    // clap keeps names for as long as the program runs.
    let name: &'static str = name.to_owned().leak();
    write_whole(&path, &page(command.name(name))?)?;
    Ok(())
}

fn page(command: Command) -> Result<Vec<u8>, RunError> {
    let mut page = Vec::new();
    Man::new(command)
        .render(&mut page)
        .map_err(|source| RunError::Io {
            action: "make",
            path: "the manual page".into(),
            source,
        })?;
    Ok(page)
}

/// A reader that has gone, as in `sos man | head`, is no error.
fn print(text: &[u8]) {
    let _ = std::io::stdout().write_all(text);
}
