//! A COLMAP scene, for those who want its masks converted or its photos in one place.

use crate::error::ImportError;
use crate::format::Detected;
use crate::gather::Imported;
use io_colmap::Scene;
use std::path::Path;

pub(crate) fn read(detected: &Detected, images: Option<&Path>) -> Result<Imported, ImportError> {
    if let Some(folder) = images {
        return Err(ImportError::bad(
            folder,
            "a COLMAP model finds its photos beside it, under the names they were registered with",
            "put them into images/ and leave --images out",
        ));
    }
    let scene = Scene::open(&detected.root)?;
    let photos = scene
        .model
        .views
        .iter()
        .map(|view| scene.image_path(view))
        .collect();
    Ok(Imported {
        format: detected.format,
        masks: vec![None; scene.model.views.len()],
        photos,
        root: detected.root.clone(),
        notes: scene.notes,
        dropped: Vec::new(),
        model: scene.model,
    })
}
