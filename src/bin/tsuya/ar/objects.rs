//! The objects of `tsuya ar`, and where they stand.

use crate::source;
use crate::surroundings;
use crate::values::triple;
use anyhow::Result;
use clap::Args;
use std::path::PathBuf;
use tsuya::ar::{ArAssembly, ArObject, Placement};
use tsuya::container::metres_per_unit;
use tsuya::decoder::ViewSelection;
use tsuya::marker::Rig;
use tsuya::relight::{AssetRenderer, AssetShading, Occlusion, RenderObject};
use tsuya::{Asset, Error, View};

#[derive(Args)]
#[command(next_help_heading = "Placement")]
pub struct PlacementArguments {
    /// The marker stands upright; otherwise it lies on the ground.
    #[arg(long)]
    pub upright: bool,
    /// The point of the ground where the object stands, in the unit of the marker's size: x to the right on the print, y up, z towards its lower edge (upright: out
    /// of it). With several objects, this and what follows comes once for all of them, or for each in their order.
    #[arg(long, alias = "at", value_name = "X,Y,Z", value_parser = triple, default_value = "0,0,0", allow_hyphen_values = true)]
    translate: Vec<[f64; 3]>,
    /// Turns the object about +Y, counter-clockwise from above, degrees.
    #[arg(long, alias = "turn", value_name = "DEG", default_value = "0", allow_hyphen_values = true)]
    rotate_y: Vec<f64>,
    /// Length of the file's unit in the unit of the marker's size [default: metres by the file's units, else so that its longest side is the
    /// marker's].
    #[arg(long, value_name = "FACTOR", conflicts_with = "size")]
    scale: Vec<f64>,
    /// Length of its longest side, in the unit of the marker's size.
    #[arg(long, value_name = "LENGTH")]
    size: Vec<f64>,
}

impl PlacementArguments {
    /// What is given for an object: for each one value, or one for all.
    fn of<T: Copy>(values: &[T], name: &str, object: usize, count: usize) -> Result<Option<T>> {
        match values {
            [] => Ok(None),
            [one] => Ok(Some(*one)),
            _ if values.len() == count => Ok(Some(values[object])),
            _ => {
                let message =
                    format!("--{name} comes {} times for {count} objects: once, or once for each", values.len());
                Err(Error::parameter(message).into())
            }
        }
    }

    fn placement(&self, asset: &Asset, rig: &Rig, object: usize, count: usize) -> Result<Placement> {
        let translate = Self::of(&self.translate, "translate", object, count)?.unwrap_or_default();
        let rotate_y = Self::of(&self.rotate_y, "rotate-y", object, count)?.unwrap_or_default();
        let upright = View::upright_rotation(&asset.views);
        let measured = Placement::on_ground(&asset.mesh, upright, 0.0, 1.0, [0.0; 3])?;
        let points = || asset.mesh.positions.iter().map(|p| measured.to_world(p.map(f64::from)));
        let extent = |k: usize| {
            let (low, high) = points().fold((f64::MAX, f64::MIN), |(low, high), p| (low.min(p[k]), high.max(p[k])));
            high - low
        };
        let longest = (0..3).map(extent).fold(0.0, f64::max).max(1e-30);
        let has_units =
            asset.metadata.get("units").and_then(|u| u.as_str()).is_some_and(|u| ["mm", "cm", "m"].contains(&u));
        let (scale, size) =
            (Self::of(&self.scale, "scale", object, count)?, Self::of(&self.size, "size", object, count)?);
        let scale = match (scale, size) {
            (Some(scale), _) => scale,
            (None, Some(length)) => length / longest,
            (None, None) if has_units => metres_per_unit(&asset.metadata),
            (None, None) => rig.markers.first().map_or(1.0, |m| m.size) / longest,
        };
        Ok(Placement::on_ground(&asset.mesh, upright, rotate_y, scale, translate)?)
    }
}

/// Assets as they were read, with their places.
pub struct Objects(Vec<(Asset, Placement)>);

impl Objects {
    /// Reads the files that are numbers `which` of all; `still` needs the photographs of a single one, too.
    pub fn read(
        files: &[PathBuf],
        which: &[usize],
        arguments: &PlacementArguments,
        rig: &Rig,
        still: bool,
    ) -> Result<Self> {
        let selection = || if still && which.len() == 1 { ViewSelection::All } else { ViewSelection::None };
        let read = |&object: &usize| {
            let asset = source::decode(&files[object], selection())?.0;
            let placement = arguments.placement(&asset, rig, object, files.len())?;
            Ok((asset, placement))
        };
        which.iter().map(read).collect::<Result<_>>().map(Objects)
    }

    /// Prepares what is drawn.
    pub fn prepare(&self, taps: usize, still: bool) -> Result<PreparedObjects<'_>> {
        if let [(asset, placement)] = &self.0[..] {
            return Ok(PreparedObjects::Single(Box::new(PreparedAsset {
                asset,
                placement: *placement,
                occlusion: surroundings::stored_occlusion(&asset.mesh, asset.visibility.as_ref())?,
                shading: AssetShading::new(asset, taps)?,
                // What was modelled has no photographs to take detail from.
                renderer: if still && !asset.is_modelled() { Some(AssetRenderer::new(asset)?) } else { None },
            })));
        }
        let parts: Vec<(&Asset, Placement)> = self.0.iter().map(|(asset, placement)| (asset, *placement)).collect();
        Ok(PreparedObjects::Several(Box::new(ArAssembly::new(&parts, taps)?)))
    }
}

/// What is drawn: one asset as it is, or several as one object.
pub enum PreparedObjects<'a> {
    Single(Box<PreparedAsset<'a>>),
    Several(Box<ArAssembly<'a>>),
}

/// One asset with what drawing it takes.
pub struct PreparedAsset<'a> {
    asset: &'a Asset,
    placement: Placement,
    occlusion: Occlusion,
    shading: AssetShading<'a>,
    renderer: Option<AssetRenderer<'a>>,
}

impl<'a> PreparedObjects<'a> {
    pub fn object(&'a self) -> Result<ArObject<'a>> {
        let single = match self {
            PreparedObjects::Single(single) => single,
            PreparedObjects::Several(assembly) => return Ok(assembly.object()?),
        };
        Ok(ArObject {
            object: RenderObject::of_asset(single.asset, Some(&single.occlusion))?,
            shading: &single.shading,
            placement: single.placement,
            detail: single.renderer.as_ref().map(|renderer| (renderer, single.asset)),
        })
    }
}
