//! Models that share photos, made one by COLMAP.
//!
//! The mapper ends a model where no further photo fits it well enough, and begins another that may take photos of the
//! first in again. By these both are brought into one frame; then points and poses are refined together.

use crate::colmap::Colmap;
use crate::error::CaptureError;
use crate::models::Models;
use crate::scene::create;
use crate::watch::Watch;
use io_colmap::Model;
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

/// Photos that two models have to share: fewer do not say how they lie to each other.
const FEWEST_SHARED: usize = 3;

/// What models are merged from and where.
#[derive(Clone, Copy)]
pub(crate) struct Merging<'a> {
    pub(crate) colmap: &'a Colmap,
    pub(crate) images: &'a Path,
    pub(crate) database: &'a Path,
    /// The sorted models of the mapper.
    pub(crate) sparse: &'a Path,
    /// An own folder for what is made on the way.
    pub(crate) work: &'a Path,
    pub(crate) watch: &'a dyn Watch,
}

/// What came of it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Merged {
    pub(crate) models: Models,
    /// For the user.
    pub(crate) note: String,
}

impl Merging<'_> {
    /// Merges what shares photos with the largest of the `models`, which takes its place; `None` where there is nothing to
    /// merge, or this COLMAP cannot.
    pub(crate) fn merge(&self, models: &Models) -> Result<Option<Merged>, CaptureError> {
        if models.sizes.len() < 2 || !self.colmap.can_merge()? {
            return Ok(None);
        }
        create(self.work)?;
        let (mut whole, mut parts) = (self.sparse.join("0"), vec![0]);
        let mut known = names(&whole)?;
        // One that shares nothing with the largest may share something with what that was merged with.
        while let Some((number, merged)) = self.grown(models, &whole, &known, &parts)? {
            parts.push(number);
            whole = merged;
            known = names(&whole)?;
        }
        if parts.len() == 1 {
            return Ok(None);
        }
        let refined = self.refined(&whole)?;
        if names(&refined)?.len() <= models.registered() {
            return Ok(None);
        }
        let sizes: Vec<String> = parts.iter().map(|i| models.sizes[*i].to_string()).collect();
        let note = format!(
            "models of {} photos share some, and were merged",
            sizes.join(" and ")
        );
        for part in parts {
            let folder = self.sparse.join(part.to_string());
            fs::remove_dir_all(&folder).map_err(|e| CaptureError::io("remove", &folder, e))?;
        }
        let kept = self.sparse.join("merged");
        fs::rename(&refined, &kept).map_err(|e| CaptureError::io("rename", &refined, e))?;
        let models = Models::sort(self.sparse)?;
        Ok(Some(Merged { models, note }))
    }

    /// A model that shares photos with the `whole`, by its number, and both in one; `None` if none of those left does.
    fn grown(
        &self,
        models: &Models,
        whole: &Path,
        known: &BTreeSet<String>,
        parts: &[usize],
    ) -> Result<Option<(usize, PathBuf)>, CaptureError> {
        for number in (0..models.sizes.len()).filter(|i| !parts.contains(i)) {
            let other = self.sparse.join(number.to_string());
            let photos = names(&other)?;
            let shared = photos.intersection(known).count();
            if shared < FEWEST_SHARED || shared == photos.len() {
                continue;
            }
            let merged = self
                .work
                .join(format!("with-{number}-after-{}", parts.len()));
            create(&merged)?;
            self.colmap.merge(whole, &other, &merged, self.watch)?;
            // Where they do not fit, COLMAP writes one of them, or nothing.
            let fits = merged.join("images.bin").is_file() && names(&merged)?.len() > known.len();
            if fits {
                return Ok(Some((number, merged)));
            }
        }
        Ok(None)
    }

    /// With points and poses as both models together have them.
    fn refined(&self, whole: &Path) -> Result<PathBuf, CaptureError> {
        let folder = |name: &str| {
            let folder = self.work.join(name);
            create(&folder).map(|()| folder)
        };
        let (adjusted, completed, refined) = (
            folder("adjusted")?,
            folder("completed")?,
            folder("refined")?,
        );
        self.colmap.adjust(whole, &adjusted, self.watch)?;
        self.colmap.complete(
            &adjusted,
            (self.images, self.database),
            &completed,
            self.watch,
        )?;
        self.colmap.adjust(&completed, &refined, self.watch)?;
        Ok(refined)
    }
}

/// The photos that have poses in a model.
fn names(model: &Path) -> Result<BTreeSet<String>, CaptureError> {
    let model = Model::read(model)?;
    Ok(model.views.into_iter().map(|view| view.name).collect())
}
