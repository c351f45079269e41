//! Laying values over a configuration: one way for files and for `--set`.

use super::{ConfigError, Difference, TrainConfig};
use crate::words::{NEAREST, did_you_mean};
use toml::{Table, Value};

/// Lays `top` over `base`.
pub(super) fn lay_over(base: &TrainConfig, top: Table) -> Result<TrainConfig, ConfigError> {
    let mut tree = tree(base)?;
    for (key, value) in flatten(top) {
        let given = value.to_string();
        set(&mut tree, &key, value)?;
        // Read after each, so that an error names what is wrong.
        read(tree.clone()).map_err(|error| of_value(error, &key, &given))?;
    }
    read(tree)
}

/// Lays one `key=value` over `base`.
pub(super) fn assign(base: &TrainConfig, assignment: &str) -> Result<TrainConfig, ConfigError> {
    let Some((key, text)) = assignment.split_once('=') else {
        return Err(ConfigError::Assignment {
            text: assignment.to_owned(),
        });
    };
    let (key, text) = (key.trim(), text.trim());
    if key == "preset" {
        return Err(ConfigError::Value {
            key: key.to_owned(),
            value: text.to_owned(),
            reason: "a preset is the start of a configuration; give it as --preset".to_owned(),
        });
    }
    let mut tree = tree(base)?;
    set(&mut tree, key, parse(text))?;
    read(tree).map_err(|error| of_value(error, key, text))
}

/// The value that was set last is what is wrong.
fn of_value(error: ConfigError, key: &str, given: &str) -> ConfigError {
    match error {
        ConfigError::Syntax { reason } => ConfigError::Value {
            key: key.to_owned(),
            value: given.to_owned(),
            reason: reworded(&reason),
        },
        other => other,
    }
}

/// What a parser says about a word that is none of a list, so that it names the nearest.
pub(super) fn reworded(reason: &str) -> String {
    // "unknown variant `bth`, expected one of `both`, `object`"
    let mut words = reason.split('`').skip(1).step_by(2);
    match words.next() {
        Some(given) if reason.starts_with("unknown variant") => {
            let known: Vec<&str> = words.collect();
            let near = did_you_mean(given, known.iter().copied());
            format!("it can be {}{near}", known.join(", "))
        }
        _ => reason.to_owned(),
    }
}

/// All keys with their sections.
pub(super) fn keys(config: &TrainConfig) -> Vec<String> {
    let tree = tree(config).unwrap_or_default();
    flatten(tree).into_iter().map(|(key, _)| key).collect()
}

/// All keys with their values, sorted.
pub(super) fn entries(config: &TrainConfig) -> Result<Vec<(String, Value)>, ConfigError> {
    Ok(flatten(tree(config)?))
}

/// The first key whose values differ.
pub(super) fn difference(
    a: &TrainConfig,
    b: &TrainConfig,
) -> Result<Option<Difference>, ConfigError> {
    let pairs = entries(a)?.into_iter().zip(entries(b)?);
    Ok(pairs
        .filter(|((_, a), (_, b))| a != b)
        .map(|((key, a), (_, b))| Difference {
            key,
            values: [a.to_string(), b.to_string()],
        })
        .next())
}

/// A word needs no quotes on a command line, everything else is as in the file.
fn parse(text: &str) -> Value {
    format!("value = {text}")
        .parse::<Table>()
        .ok()
        .and_then(|mut table| table.remove("value"))
        .unwrap_or_else(|| Value::String(text.to_owned()))
}

fn tree(config: &TrainConfig) -> Result<Table, ConfigError> {
    Table::try_from(config).map_err(|e| ConfigError::Syntax {
        reason: one_line(e.to_string()),
    })
}

fn read(tree: Table) -> Result<TrainConfig, ConfigError> {
    tree.try_into()
        .map_err(|e: toml::de::Error| ConfigError::Syntax {
            reason: one_line(e.message()),
        })
}

fn flatten(table: Table) -> Vec<(String, Value)> {
    table
        .into_iter()
        .flat_map(|(key, value)| match value {
            Value::Table(section) => flatten(section)
                .into_iter()
                .map(|(inner, value)| (format!("{key}.{inner}"), value))
                .collect(),
            value => vec![(key, value)],
        })
        .collect()
}

fn set(tree: &mut Table, key: &str, value: Value) -> Result<(), ConfigError> {
    let slot = match key.split_once('.') {
        Some((section, name)) => tree
            .get_mut(section)
            .and_then(Value::as_table_mut)
            .and_then(|section| section.get_mut(name)),
        None => tree.get_mut(key).filter(|value| !value.is_table()),
    };
    let Some(slot) = slot else {
        return Err(ConfigError::UnknownKey {
            key: key.to_owned(),
            remedy: nearest(key),
        });
    };
    *slot = coerce(slot, value).map_err(|(value, reason)| ConfigError::Value {
        key: key.to_owned(),
        value: value.to_string(),
        reason,
    })?;
    Ok(())
}

/// `value` in the kind that `old` has, where that loses nothing.
fn coerce(old: &Value, value: Value) -> Result<Value, (Value, String)> {
    match (old, value) {
        (Value::Float(_), Value::Integer(i)) => Ok(Value::Float(i as f64)),
        (Value::Float(_), value @ Value::Float(f)) => {
            if f.is_finite() {
                Ok(value)
            } else {
                Err((value, "a finite number is needed".to_owned()))
            }
        }
        // 1e4 is a number of steps as well.
        (Value::Integer(_), Value::Float(f)) if f.fract() == 0.0 && f.abs() < 9e15 => {
            Ok(Value::Integer(f as i64))
        }
        (Value::Integer(_), value @ Value::Integer(i)) => {
            if i >= 0 {
                Ok(value)
            } else {
                Err((value, "it cannot be negative".to_owned()))
            }
        }
        (Value::String(_), value @ Value::String(_))
        | (Value::Boolean(_), value @ Value::Boolean(_)) => Ok(value),
        (Value::Float(_), value) => Err((value, "a number is needed".to_owned())),
        (Value::Integer(_), value) => Err((value, "a whole number is needed".to_owned())),
        (Value::Boolean(_), value) => Err((value, "true or false is needed".to_owned())),
        (_, value) => Err((value, "a word is needed".to_owned())),
    }
}

/// "did you mean …", from spelling and, for a name in the wrong section, from its last part.
fn nearest(key: &str) -> String {
    let name = |key: &str| key.rsplit('.').next().unwrap_or(key).to_owned();
    let mut keys: Vec<(usize, String)> = TrainConfig::keys()
        .into_iter()
        .map(|known| {
            let whole = strsim::damerau_levenshtein(key, &known);
            let last = strsim::damerau_levenshtein(&name(key), &name(&known)) + 1;
            (whole.min(last), known)
        })
        .collect();
    keys.sort();
    let best = keys.first().map_or(0, |(distance, _)| *distance);
    if best > NEAREST {
        return "the keys are those of the config.toml that every run writes".to_owned();
    }
    let near: Vec<String> = keys
        .into_iter()
        .take_while(|(distance, _)| *distance == best)
        .take(3)
        .map(|(_, key)| key)
        .collect();
    format!("did you mean {}?", near.join(" or "))
}

/// Parsers like to quote the file over several lines.
pub(super) fn one_line(text: impl AsRef<str>) -> String {
    text.as_ref()
        .split_whitespace()
        .collect::<Vec<_>>()
        .join(" ")
}
