//! Photos that are no views of a scene, though there may be masks of them: those without a pose, and those that are gone.

use crate::gather::{Imported, plain};
use io_colmap::{Listing, PICTURE_ENDINGS, Search, without_ending};
use std::collections::{BTreeMap, BTreeSet, HashSet};
use std::path::{Path, PathBuf};

impl Imported {
    /// The pictures beside the views' photos, and views that were left out, named as views are. What lies with the
    /// `masks` is one of those.
    pub(crate) fn unposed(&self, masks: &Path) -> Listing {
        let masks = masks.canonicalize().ok();
        let used = self.photos.iter().chain(self.masks.iter().flatten());
        let used: HashSet<PathBuf> = used.map(|path| plain(path)).collect();
        let folders = self.photo_folders();
        let mut all = Listing::default();
        let mut names = BTreeSet::new();
        for (folder, prefix) in &folders {
            // Photos beside the file that was named have none.
            let place = if folder.as_os_str().is_empty() {
                Path::new(".")
            } else {
                folder
            };
            let whole = place.canonicalize().ok();
            if (masks.as_ref().zip(whole)).is_some_and(|(masks, whole)| whole.starts_with(masks)) {
                continue;
            }
            // One that cannot be listed has photos that can be opened, and shows no others.
            let mut found = PICTURES.list(place).unwrap_or_default();
            let others = found.names.iter();
            let others = others.filter(|name| !used.contains(&folder.join(name)));
            names.extend(others.map(|name| format!("{prefix}{name}")));
            all.unnamed.append(&mut found.unnamed);
        }
        let bare = |name: &str| {
            let file = name.rsplit('/').next().unwrap_or_default();
            without_ending(file).to_lowercase()
        };
        let listed: HashSet<String> = names.iter().map(|name| bare(name)).collect();
        for dropped in &self.dropped {
            let stated = PathBuf::from(dropped.name.replace('\\', "/"));
            let path = plain(&self.root.join(&stated));
            // A view that was listed twice is a view, and is named by where its photo is.
            if used.contains(&path) || used.contains(&plain(&stated)) {
                continue;
            }
            let Some(name) = stated.file_name() else {
                continue;
            };
            // Its photo is there, if by a name that has an ending.
            if listed.contains(&bare(&name.to_string_lossy())) {
                continue;
            }
            let prefix = path.parent().and_then(|folder| folders.get(folder));
            names.insert(format!(
                "{}{}",
                prefix.map_or("", String::as_str),
                name.to_string_lossy()
            ));
        }
        all.names.extend(names);
        all
    }

    /// The folders that the views' photos are in, and what views' names begin with there.
    fn photo_folders(&self) -> BTreeMap<PathBuf, String> {
        let views = self.model.views.iter().zip(&self.photos);
        views
            .filter_map(|(view, photo)| {
                let prefix = view.name.rfind('/').map_or("", |at| &view.name[..=at]);
                Some((plain(photo).parent()?.to_path_buf(), prefix.to_owned()))
            })
            .collect()
    }
}

const PICTURES: Search<'static> = Search {
    depth: 0,
    endings: &PICTURE_ENDINGS,
    mask_folders: false,
};
