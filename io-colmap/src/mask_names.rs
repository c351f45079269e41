//! Which mask file belongs to which photo.

use crate::endings::without_ending;
use std::collections::{BTreeMap, HashMap, HashSet};

/// From a photo's stem and full name to its mask's name without ending.
type Naming = fn(&str, &str) -> String;

/// The naming schemes by which masks are looked up; folders are handled apart.
const SCHEMES: [(&str, Naming); 8] = [
    ("stem.png", |stem, _| stem.to_owned()),
    ("name.ext.png", |_, name| name.to_owned()),
    ("stem_mask.png", |stem, _| format!("{stem}_mask")),
    ("mask_stem.png", |stem, _| format!("mask_{stem}")),
    ("stem.mask.png", |stem, _| format!("{stem}.mask")),
    ("stem-mask.png", |stem, _| format!("{stem}-mask")),
    ("dynamic_mask_stem.png", |stem, _| {
        format!("dynamic_mask_{stem}")
    }),
    ("name.ext.mask.png", |_, name| format!("{name}.mask")),
];

/// Masks matched to photos.
pub(crate) struct Matches {
    /// Parallel to the photos: index of the mask file.
    pub(crate) mask_of: Vec<Option<usize>>,
    /// How they were matched, for the summary.
    pub(crate) how: String,
    /// Set where the match is a guess the user should check.
    pub(crate) guess: Option<String>,
}

/// Whether lists of files are complete: none has what is in folders that cannot be read, and names that are not
/// Unicode.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Whole {
    pub(crate) all_photos: bool,
    pub(crate) masks: bool,
}

fn split_folder(path: &str) -> (&str, &str) {
    path.rfind('/').map_or(("", path), |i| path.split_at(i + 1))
}

/// The last run of digits in a path without its ending; leading zeros do not count.
fn trailing_number(path: &str) -> Option<u128> {
    let (_, stem) = split_folder(without_ending(path));
    let end = stem.rfind(|c: char| c.is_ascii_digit())? + 1;
    let start = stem[..end]
        .rfind(|c: char| !c.is_ascii_digit())
        .map_or(0, |i| {
            i + stem[i..].chars().next().map_or(1, char::len_utf8)
        });
    stem[start..end].parse().ok()
}

/// Matches photos (paths below the image folder) and masks (paths below the mask folder).
///
/// `all_photos` are all files of the image folder, registered or not. `None` if there is no match
/// that could be trusted.
pub(crate) fn match_masks(
    photos: &[&str],
    all_photos: &[String],
    masks: &[String],
    whole: Whole,
) -> Option<Matches> {
    let Some(named) = by_name(photos, masks) else {
        return by_number(photos, all_photos, masks)
            .or_else(|| by_order(photos, all_photos, masks, whole));
    };
    if named.is_complete() {
        return Some(named);
    }
    // Names may fit for some alone: of masks padded to three digits those of photo 100 and on.
    let numbered = by_number(photos, all_photos, masks);
    let better = numbered.filter(|all| all.extends(&named) && all.count() > named.count());
    Some(better.unwrap_or(named))
}

impl Matches {
    fn is_complete(&self) -> bool {
        self.count() == self.mask_of.len()
    }

    fn count(&self) -> usize {
        self.mask_of.iter().flatten().count()
    }

    /// Whether it has all pairs that `other` has.
    fn extends(&self, other: &Self) -> bool {
        let mut pairs = self.mask_of.iter().zip(&other.mask_of);
        pairs.all(|(mask, of_other)| of_other.is_none() || mask == of_other)
    }
}

fn by_name(photos: &[&str], masks: &[String]) -> Option<Matches> {
    let mut by_key: HashMap<&str, usize> = HashMap::new();
    let is_png = |mask: &str| mask.to_ascii_lowercase().ends_with(".png");
    for (i, mask) in masks.iter().enumerate() {
        // Of several with one name a PNG, for it has lost nothing; else the last in the list.
        let known = by_key.get(without_ending(mask));
        if known.is_none_or(|&known| is_png(mask) || !is_png(&masks[known])) {
            by_key.insert(without_ending(mask), i);
        }
    }
    let by_end = by_end(by_key.iter().map(|(key, i)| (*key, *i)));
    let path_of = |photo: &str, key: Naming| {
        let (folder, name) = split_folder(photo);
        format!("{folder}{}", key(without_ending(name), name))
    };
    let mut bare_count: HashMap<&str, usize> = HashMap::new();
    for photo in photos {
        *bare_count
            .entry(without_ending(split_folder(photo).1))
            .or_default() += 1;
    }
    let beside = |photo: &str, key: Naming| -> Option<usize> {
        let (folder, name) = split_folder(photo);
        let without_folder = || {
            // Only where that cannot be mistaken.
            let unique = !folder.is_empty() && bare_count.get(without_ending(name)) == Some(&1);
            let wanted = key(without_ending(name), name);
            unique.then(|| by_key.get(wanted.as_str()).copied())?
        };
        let direct = by_key.get(path_of(photo, key).as_str()).copied();
        direct.or_else(without_folder)
    };
    let further_in = |photo: &str, key: Naming| {
        let end = by_end.get(path_of(photo, key).as_str());
        end.copied().flatten()
    };
    // All masks may lie in a folder that photos' names leave out. Where some do not, others in folders are of other use.
    named_by(photos, beside).or_else(|| named_by(photos, further_in))
}

/// Photos' masks as `find` has them for each way of naming: by those that fit most photos first.
fn named_by(photos: &[&str], find: impl Fn(&str, Naming) -> Option<usize>) -> Option<Matches> {
    let mut schemes: Vec<(usize, &str, Naming)> = SCHEMES
        .iter()
        .map(|&(label, key)| {
            (
                photos.iter().filter(|p| find(p, key).is_some()).count(),
                label,
                key,
            )
        })
        .filter(|(hits, ..)| *hits > 0)
        .collect();
    schemes.sort_by_key(|(hits, ..)| std::cmp::Reverse(*hits));
    let (_, label, _) = schemes.first()?;
    let how = format!("named like {label}");
    let mut taken = HashSet::new();
    let mask_of = photos
        .iter()
        .map(|photo| {
            schemes
                .iter()
                .filter_map(|(_, _, key)| find(photo, *key))
                .find(|mask| taken.insert(*mask))
        })
        .collect();
    Some(Matches {
        mask_of,
        how,
        guess: None,
    })
}

/// Masks by the ends of their paths that leave out folders; `None` where several share one.
fn by_end<'a>(masks: impl Iterator<Item = (&'a str, usize)>) -> HashMap<&'a str, Option<usize>> {
    let mut ends = HashMap::new();
    for (path, i) in masks {
        for (at, _) in path.match_indices('/') {
            ends.entry(&path[at + 1..])
                .and_modify(|known| *known = None)
                .or_insert(Some(i));
        }
    }
    ends
}

/// Numbered files whose padding or prefix differs: `frame_000.jpg` and `00000.png`.
fn by_number(photos: &[&str], all_photos: &[String], masks: &[String]) -> Option<Matches> {
    let mut mask_at = BTreeMap::new();
    for (i, mask) in masks.iter().enumerate() {
        if mask_at.insert(trailing_number(mask)?, i).is_some() {
            return None;
        }
    }
    let numbers: Vec<u128> = photos
        .iter()
        .map(|p| trailing_number(p))
        .collect::<Option<_>>()?;
    let distinct: HashSet<u128> = numbers.iter().copied().collect();
    // A mask whose number no photo has means that the two are counted differently (from 0 and
    // from 1, say): then equal numbers would pair the wrong files.
    let known: HashSet<u128> = all_photos
        .iter()
        .filter_map(|p| trailing_number(p))
        .chain(numbers.iter().copied())
        .collect();
    if distinct.len() != numbers.len() || mask_at.keys().any(|n| !known.contains(n)) {
        return None;
    }
    let mask_of: Vec<Option<usize>> = numbers.iter().map(|n| mask_at.get(n).copied()).collect();
    if mask_of.iter().all(Option::is_none) {
        return None;
    }
    let how = "with the photo's number".to_owned();
    let guess = "masks were matched to photos by the number in their names".to_owned();
    Some(Matches {
        mask_of,
        how,
        guess: Some(guess),
    })
}

/// As many masks as photos: the first belongs to the first, and so on. One that is not in the list would move all
/// that come after it.
fn by_order(
    photos: &[&str],
    all_photos: &[String],
    masks: &[String],
    whole: Whole,
) -> Option<Matches> {
    let everything: Vec<&str> = all_photos.iter().map(String::as_str).collect();
    let list: &[&str] = if !whole.masks {
        return None;
    } else if masks.len() == photos.len() {
        photos
    } else if whole.all_photos && masks.len() == everything.len() {
        &everything
    } else {
        return None;
    };
    let mut photo_order = list.to_vec();
    photo_order.sort_by_key(|p| natural(p));
    let mut mask_order: Vec<usize> = (0..masks.len()).collect();
    mask_order.sort_by_key(|&i| natural(&masks[i]));
    let pairs: HashMap<&str, usize> = photo_order
        .iter()
        .copied()
        .zip(mask_order.iter().copied())
        .collect();
    let mask_of = photos.iter().map(|p| pairs.get(p).copied()).collect();
    let guess = format!(
        "no mask has a photo's name; there are as many masks as photos ({}), so they were matched in sorted order, {} to {}: check that this is right",
        masks.len(),
        mask_order.first().map_or("", |&i| masks[i].as_str()),
        photo_order.first().copied().unwrap_or_default()
    );
    Some(Matches {
        mask_of,
        how: "in sorted order".to_owned(),
        guess: Some(guess),
    })
}

/// A sort key under which `img2` comes before `img10`: digits as numbers, the rest as text.
fn natural(name: &str) -> Vec<(u128, String)> {
    let mut parts: Vec<(u128, String)> = Vec::new();
    let mut rest = without_ending(name);
    while !rest.is_empty() {
        let text_end = rest
            .find(|c: char| c.is_ascii_digit())
            .unwrap_or(rest.len());
        let (text, tail) = rest.split_at(text_end);
        let digits_end = tail
            .find(|c: char| !c.is_ascii_digit())
            .unwrap_or(tail.len());
        let (digits, tail) = tail.split_at(digits_end);
        parts.push((0, text.to_owned()));
        parts.push((digits.parse().unwrap_or(u128::MAX), String::new()));
        rest = tail;
    }
    parts
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    const WHOLE: Whole = Whole {
        all_photos: true,
        masks: true,
    };

    fn pairs(photos: &[&str], masks: &[&str]) -> Option<Vec<Option<usize>>> {
        let masks: Vec<String> = masks.iter().map(|m| (*m).to_owned()).collect();
        let all: Vec<String> = photos.iter().map(|m| (*m).to_owned()).collect();
        match_masks(photos, &all, &masks, WHOLE).map(|m| m.mask_of)
    }

    #[test]
    fn every_naming_scheme_matches() {
        let photos = ["a.jpg", "b.JPG"];
        for masks in [
            ["a.png", "b.png"],
            ["a.jpg", "b.jpeg"],
            ["a.jpg.png", "b.JPG.png"],
            ["a_mask.png", "b_mask.png"],
            ["mask_a.png", "mask_b.png"],
            ["a.mask.png", "b.mask.png"],
            ["dynamic_mask_a.png", "dynamic_mask_b.png"],
        ] {
            assert_eq!(
                pairs(&photos, &masks),
                Some(vec![Some(0), Some(1)]),
                "{masks:?}"
            );
        }
        assert_eq!(pairs(&photos, &["b_mask.png"]), Some(vec![None, Some(0)]));
        assert_eq!(
            pairs(&["c1/a.jpg", "c2/a.jpg"], &["c2/a.png"]),
            Some(vec![None, Some(0)])
        );
        assert_eq!(pairs(&["c1/a.jpg", "c2/a.jpg"], &["a.png"]), None);
        assert_eq!(
            pairs(&["c1/a.jpg", "c2/b.jpg"], &["b.png"]),
            Some(vec![None, Some(0)])
        );
    }

    #[test]
    fn folders_that_photos_do_not_have_are_passed_over_unless_they_decide() {
        let photos = ["a.jpg", "b.jpg"];
        assert_eq!(
            pairs(&photos, &["cam1/b.png", "cam1/x.png"]),
            Some(vec![None, Some(0)])
        );
        assert_eq!(
            pairs(&photos, &["cam1/a.png", "cam2/a.png", "cam1/b_mask.png"]),
            Some(vec![None, Some(2)])
        );
        // Pictures of other use do not stand in for masks that are named otherwise.
        assert_eq!(
            pairs(&photos, &["a_mask.png", "vis/a.png", "vis/b.png"]),
            Some(vec![Some(0), None])
        );
        // One that lies beside it is the photo's own.
        assert_eq!(
            pairs(&photos, &["cam1/a.png", "a.png"]),
            Some(vec![Some(1), None])
        );
        assert_eq!(
            pairs(&["c1/a.jpg", "c2/a.jpg"], &["images/c2/a.png", "c3/a.png"]),
            Some(vec![None, Some(0)])
        );
        // Of two endings one is taken, as anywhere.
        assert_eq!(
            pairs(&photos, &["cam1/a.jpg", "cam1/a.png"]),
            Some(vec![Some(1), None])
        );
    }

    #[test]
    fn of_two_masks_by_one_name_the_png_is_taken() {
        for (masks, taken) in [
            (["a.jpg", "a.png"], 1),
            (["a.PNG", "a.jpg"], 0),
            (["a.png", "a.webp"], 0),
            (["a.jpg", "a.tif"], 1),
        ] {
            assert_eq!(
                pairs(&["a.jpg"], &masks),
                Some(vec![Some(taken)]),
                "{masks:?}"
            );
        }
    }

    #[test]
    fn numbers_match_across_padding_but_not_across_counting() {
        let photos = ["frame_000.jpg", "frame_001.jpg", "frame_010.jpg"];
        assert_eq!(
            pairs(&photos, &["00001.png", "10.png"]),
            Some(vec![None, Some(0), Some(1)])
        );
        // Counted from 1: falls back to order.
        let shifted = pairs(
            &["0.jpg", "1.jpg", "2.jpg"],
            &["m1.png", "m2.png", "m3.png"],
        );
        assert_eq!(shifted, Some(vec![Some(0), Some(1), Some(2)]));
        // Neither names, numbers nor counts agree: no guess.
        assert_eq!(pairs(&["0.jpg", "1.jpg"], &["7.png"]), None);
        // Natural order: 2 before 10.
        let order = pairs(&["x.jpg", "y.jpg"], &["m10.png", "m2.png"]);
        assert_eq!(order, Some(vec![Some(1), Some(0)]));
    }

    #[test]
    fn the_order_of_a_part_is_not_that_of_all() {
        let names = |names: &[&str]| -> Vec<String> {
            names.iter().map(|name| (*name).to_owned()).collect()
        };
        let (all, masks) = (
            names(&["x.jpg", "y.jpg", "z.jpg"]),
            names(&["m.png", "n.png"]),
        );
        let matched = |photos: &[&str], all_photos: &[String], whole| {
            match_masks(photos, all_photos, &masks, whole).map(|matches| matches.mask_of)
        };
        let no_masks = Whole {
            masks: false,
            ..WHOLE
        };
        let no_photos = Whole {
            all_photos: false,
            ..WHOLE
        };
        let both = Some(vec![Some(0), Some(1)]);
        assert_eq!(matched(&["x.jpg", "y.jpg"], &all, WHOLE), both);
        assert_eq!(matched(&["x.jpg", "y.jpg"], &all, no_masks), None);
        // The registered photos are known whatever else lies beside them.
        assert_eq!(matched(&["x.jpg", "y.jpg"], &all, no_photos), both);
        assert_eq!(matched(&["y.jpg"], &all[..2], WHOLE), Some(vec![Some(1)]));
        assert_eq!(matched(&["y.jpg"], &all[..2], no_photos), None);
    }

    #[test]
    fn names_that_fit_for_some_do_not_hide_numbers_that_fit_for_more() {
        let photos = ["98.png", "99.png", "100.png", "101.png"];
        assert_eq!(
            pairs(&photos, &["098.png", "099.png", "100.png"]),
            Some(vec![Some(0), Some(1), Some(2), None])
        );
        // Where they contradict each other, or some number is of no photo, names it is.
        assert_eq!(
            pairs(&["a1.jpg", "a2.jpg"], &["a1.png", "mask_3.png"]),
            Some(vec![Some(0), None])
        );
        assert_eq!(
            pairs(
                &["shot_1.jpg", "shot_2.jpg"],
                &["mask_shot_1.png", "x2.png"]
            ),
            Some(vec![Some(0), Some(1)])
        );
    }

    #[test]
    fn missing_masks_do_not_turn_names_into_a_guess() {
        let photos = ["IMG_001.jpg", "IMG_002.jpg", "IMG_003.jpg"];
        let all = photos.map(str::to_owned);
        let masks = ["IMG_001.png", "IMG_003.png"].map(str::to_owned);
        let found = match_masks(&photos, &all, &masks, WHOLE).unwrap();
        assert_eq!(found.mask_of, [Some(0), None, Some(1)]);
        assert_eq!(
            (found.how.as_str(), found.guess),
            ("named like stem.png", None)
        );
    }

    #[test]
    fn odd_names_do_not_break_the_search_for_numbers() {
        assert_eq!(trailing_number("a/ü12ß.png"), Some(12));
        assert_eq!(trailing_number("ü.png"), None);
        assert_eq!(trailing_number(".7"), Some(7));
        assert_eq!(trailing_number(&"9".repeat(60)), None);
        assert!(
            match_masks(&[], &[], &[], WHOLE)
                .unwrap()
                .mask_of
                .is_empty()
        );
    }
}
