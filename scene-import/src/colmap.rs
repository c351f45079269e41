//! A COLMAP scene, for those who want its masks converted or its photos in one place.

use crate::error::ImportError;
use crate::format::Detected;
use crate::gather::Imported;
use io_colmap::Scene;

pub(crate) fn read(detected: &Detected) -> Result<Imported, ImportError> {
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
