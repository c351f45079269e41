//! The words for what can be exported.

use crate::error::UnknownWord;
use std::fmt;
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// A format that results can be turned into.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Target {
    /// Multi-layer OpenEXR, one file per view.
    Exr,
    /// The mesh as Wavefront OBJ with vertex colours.
    Obj,
    /// The mesh as binary glTF with vertex colours.
    Glb,
    /// Masks in COCO's JSON.
    Coco,
    /// A COLMAP scene of the object alone.
    ColmapScene,
    /// Mattes in 8 bits.
    Alpha8,
    /// Cut-outs with premultiplied alpha.
    Premultiplied,
    /// All pictures as videos, by ffmpeg.
    Video,
}

/// A tool whose conventions for masks can be followed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum MaskTool {
    /// COLMAP's `--ImageReader.mask_path`.
    Colmap,
    /// nerfstudio's `mask_path` in `transforms.json`.
    Nerfstudio,
    /// Brush's folder `masks`.
    Brush,
    /// instant-ngp's `dynamic_mask_*.png`.
    InstantNgp,
    /// NeuS's folder `mask`.
    Neus,
    /// SPIn-NeRF's folder `label`.
    SpinNerf,
}

impl Target {
    /// All of them.
    pub const ALL: [Target; 8] = [
        Target::Exr,
        Target::Obj,
        Target::Glb,
        Target::Coco,
        Target::ColmapScene,
        Target::Alpha8,
        Target::Premultiplied,
        Target::Video,
    ];

    /// A word for command lines.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Target::Exr => "exr",
            Target::Obj => "obj",
            Target::Glb => "glb",
            Target::Coco => "coco",
            Target::ColmapScene => "colmap-scene",
            Target::Alpha8 => "alpha8",
            Target::Premultiplied => "premultiplied",
            Target::Video => "video",
        }
    }
}

impl MaskTool {
    /// All of them.
    pub const ALL: [MaskTool; 6] = [
        MaskTool::Colmap,
        MaskTool::Nerfstudio,
        MaskTool::Brush,
        MaskTool::InstantNgp,
        MaskTool::Neus,
        MaskTool::SpinNerf,
    ];

    /// A word for command lines.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            MaskTool::Colmap => "colmap",
            MaskTool::Nerfstudio => "nerfstudio",
            MaskTool::Brush => "brush",
            MaskTool::InstantNgp => "instant-ngp",
            MaskTool::Neus => "neus",
            MaskTool::SpinNerf => "spin-nerf",
        }
    }
}

/// What to export.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Product {
    /// Results in another format.
    Files(Target),
    /// Masks for a tool.
    Masks(MaskTool),
}

impl Product {
    /// Where it goes unless stated: a folder in the run's `export/`.
    #[must_use]
    pub fn default_folder(self, run: &Path) -> PathBuf {
        run.join("export").join(self.to_string())
    }
}

impl fmt::Display for Product {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Product::Files(target) => f.write_str(target.name()),
            Product::Masks(tool) => write!(f, "masks-{}", tool.name()),
        }
    }
}

impl FromStr for Target {
    type Err = UnknownWord;

    fn from_str(word: &str) -> Result<Self, UnknownWord> {
        find(&Target::ALL, Target::name, "export", word)
    }
}

impl FromStr for MaskTool {
    type Err = UnknownWord;

    fn from_str(word: &str) -> Result<Self, UnknownWord> {
        find(&MaskTool::ALL, MaskTool::name, "tool", word)
    }
}

fn find<T: Copy>(
    all: &[T],
    name: fn(T) -> &'static str,
    kind: &'static str,
    word: &str,
) -> Result<T, UnknownWord> {
    if let Some(found) = all.iter().find(|one| name(**one) == word) {
        return Ok(*found);
    }
    let names: Vec<&'static str> = all.iter().map(|one| name(*one)).collect();
    let typed = word.to_lowercase();
    Err(UnknownWord {
        kind,
        word: word.to_owned(),
        nearest: names
            .iter()
            .copied()
            // The beginning of a name says more than a name of the same length.
            .min_by_key(|name| {
                let edits = strsim::damerau_levenshtein(&typed, name);
                (typed.is_empty() || !name.starts_with(&typed), edits)
            })
            .unwrap_or_default(),
        list: names.join(", "),
    })
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn every_name_leads_back() {
        for target in Target::ALL {
            assert_eq!(target.name().parse(), Ok(target));
        }
        for tool in MaskTool::ALL {
            assert_eq!(tool.name().parse(), Ok(tool));
        }
    }

    #[test]
    fn an_unknown_word_gets_the_nearest() {
        for (word, nearest) in [
            ("EXR", "exr"),
            ("gltf", "glb"),
            ("colmap", "colmap-scene"),
            ("alpha", "alpha8"),
        ] {
            let error = word.parse::<Target>().unwrap_err();
            assert_eq!(error.nearest, nearest, "{word}");
            assert!(error.to_string().contains(word), "{error}");
        }
        let error = "nerf-studio".parse::<MaskTool>().unwrap_err();
        assert_eq!(error.nearest, "nerfstudio");
    }
}
