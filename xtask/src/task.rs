//! Which tasks there are and how a command line names one.

use std::{ffi::OsString, fmt};

/// What `cargo xtask` prints on its own.
pub(crate) const HELP: &str = "\
The commands of this workspace. Arguments after the task's name go to the program unchanged.

usage: cargo xtask TASK [ARGUMENTS]

  train [SCENE]   train a scene and write mattes, plates, normals, depth and mesh (sos train)
  doctor SCENE    check a scene before training on it, each finding with a remedy (sos doctor)
  import SCENE    turn poses of another tool into a COLMAP scene (sos import)
  export RUN      turn results into EXR layers, OBJ, GLB, COCO, tools' masks (sos export)
  eval RUN        score a run against ground truth (sos eval)
  compare ...     score runs and other systems' masks side by side (sos compare)
  ablate SCENE    train and score the paper's ablation, with --rivals others too (sos ablate)
  results SCENE.. train and score scenes from several kinds of masks (sos results)
  sos ...         any other command of the sos program
  demo OUT        write the demo scene with its exact ground truth (demo-scene)
  test            run all tests; with --device wgpu just the GPU kernels', none skipped
  bench           speed of training against this machine's peaks (sos-bench)
  check           formatting, lints, documentation; licences and spelling where installed
  ci              check, then test: what a change must pass

examples:
  cargo xtask train                                   the demo scene, into runs/demo
  cargo xtask train shots/cat --masks shots/cat/masks
  cargo xtask train --help                            all options of a task
  cargo xtask test -p losses schedules                one package, tests of that name";

/// A task that `cargo xtask` can do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Task {
    Train,
    Doctor,
    Import,
    Export,
    Eval,
    Compare,
    Ablate,
    Results,
    Sos,
    Demo,
    Test,
    Bench,
    Check,
    Ci,
}

const TASKS: [(&str, Task); 14] = [
    ("train", Task::Train),
    ("doctor", Task::Doctor),
    ("import", Task::Import),
    ("export", Task::Export),
    ("eval", Task::Eval),
    ("compare", Task::Compare),
    ("ablate", Task::Ablate),
    ("results", Task::Results),
    ("sos", Task::Sos),
    ("demo", Task::Demo),
    ("test", Task::Test),
    ("bench", Task::Bench),
    ("check", Task::Check),
    ("ci", Task::Ci),
];

/// What a command line asks for.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Request {
    Help,
    /// A task with the arguments to pass on.
    Run(Task, Vec<OsString>),
}

/// The first argument names no task.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct UnknownTask {
    word: String,
    nearest: &'static str,
}

impl fmt::Display for UnknownTask {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { word, nearest } = self;
        write!(
            f,
            "no task is called `{word}`; did you mean `cargo xtask {nearest}`?"
        )
    }
}

/// Reads the arguments after `cargo xtask`.
pub(crate) fn parse(mut arguments: impl Iterator<Item = OsString>) -> Result<Request, UnknownTask> {
    let Some(word) = arguments.next() else {
        return Ok(Request::Help);
    };
    let word = word.to_string_lossy();
    if ["help", "--help", "-h"].contains(&&*word) {
        return Ok(Request::Help);
    }
    match TASKS.iter().find(|(name, _)| *name == word) {
        Some(&(_, task)) => Ok(Request::Run(task, arguments.collect())),
        None => Err(UnknownTask {
            nearest: nearest(&word),
            word: word.into_owned(),
        }),
    }
}

/// The task whose name takes the fewest edits to reach, the first of them in a tie.
fn nearest(word: &str) -> &'static str {
    let names = TASKS.iter().map(|&(name, _)| name).chain(["help"]);
    let word = word.to_lowercase();
    names
        .min_by_key(|name| strsim::damerau_levenshtein(&word, name))
        .unwrap_or("help")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse_words(words: &[&str]) -> Result<Request, UnknownTask> {
        parse(words.iter().map(OsString::from))
    }

    #[test]
    fn nothing_asks_for_help() {
        for words in [&[][..], &["help"], &["--help"], &["-h", "train"]] {
            assert_eq!(parse_words(words), Ok(Request::Help), "{words:?}");
        }
    }

    #[test]
    fn every_task_is_found_by_its_name() {
        for (name, task) in TASKS {
            assert_eq!(
                parse_words(&[name]),
                Ok(Request::Run(task, vec![])),
                "{name}"
            );
        }
    }

    #[test]
    fn arguments_are_passed_on_untouched() {
        let words = ["train", "my scene", "--help", "--", "-x", ""];
        let passed = words[1..].iter().map(OsString::from).collect();
        assert_eq!(parse_words(&words), Ok(Request::Run(Task::Train, passed)));
    }

    #[cfg(unix)]
    #[test]
    fn paths_need_not_be_unicode() {
        use std::os::unix::ffi::OsStringExt;
        let path = OsString::from_vec(vec![b'a', 0xff]);
        let request = parse([OsString::from("train"), path.clone()].into_iter());
        assert_eq!(request, Ok(Request::Run(Task::Train, vec![path])));
    }

    #[test]
    fn an_unknown_word_gets_the_nearest_task() {
        for (word, expected) in [
            ("trian", "train"),
            ("evla", "eval"),
            ("TEST", "test"),
            ("chekc", "check"),
            ("c", "ci"),
        ] {
            let error = parse_words(&[word, "x"]).expect_err(word);
            assert_eq!(error.nearest, expected, "{word}");
            assert!(error.to_string().contains(word), "{error}");
        }
    }

    #[test]
    fn the_help_names_every_task_and_fits_a_screen() {
        for (name, _) in TASKS {
            assert!(
                HELP.lines()
                    .any(|line| line.starts_with(&format!("  {name} "))),
                "{name}"
            );
        }
        assert!(HELP.lines().count() <= 24, "{} lines", HELP.lines().count());
        assert!(HELP.lines().all(|line| line.chars().count() <= 100));
    }
}
