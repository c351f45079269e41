//! Names of photos, masks and results with and without their ending.

use std::collections::HashMap;

/// A photo's or mask's path without its last ending: `a/b.jpg.png` gives `a/b.jpg`. A name that begins with a dot has none.
#[must_use]
pub fn without_ending(path: &str) -> &str {
    let file_at = path.rfind('/').map_or(0, |i| i + 1);
    match path[file_at..].rfind('.') {
        Some(dot) if dot > 0 => &path[..file_at + dot],
        _ => path,
    }
}

/// The first two of these paths that differ only in their ending, and so in nothing that a mask or a result is named by.
pub fn alike_without_ending<'a>(paths: impl IntoIterator<Item = &'a str>) -> Option<[&'a str; 2]> {
    let mut known = HashMap::new();
    paths
        .into_iter()
        .find_map(|path| Some([known.insert(without_ending(path), path)?, path]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_that_differ_in_their_ending_are_alike() {
        let alike = |paths: &[&'static str]| alike_without_ending(paths.iter().copied());
        assert_eq!(
            alike(&["b.jpg", "a/1.jpg", "c.png", "a/1.png"]),
            Some(["a/1.jpg", "a/1.png"])
        );
        assert_eq!(alike(&["a/1.jpg", "b/1.jpg", "a/1.jpg.png"]), None);
    }

    #[test]
    fn endings_go_and_folders_stay() {
        for (name, stem) in [
            ("a/b.jpg", "a/b"),
            ("a.b/c", "a.b/c"),
            ("a/.hidden", "a/.hidden"),
            ("x.y.png", "x.y"),
        ] {
            assert_eq!(without_ending(name), stem);
        }
    }
}
