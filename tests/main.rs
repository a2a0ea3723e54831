//! The tests of the whole, one program: what they share is compiled once, and no core waits for the last test of a file. Those of single
//! stages need the feature `internals`. What looks at its own process stands alone: `memory.rs`, `view_abuse`.

#[cfg(feature = "internals")]
mod agreement;
mod ar;
mod ar_video;
mod brdf;
mod brdf_measure;
mod brdf_plan;
#[cfg(feature = "internals")]
mod captures;
mod check;
mod command_line;
mod container_description;
mod damage;
mod document_materials;
mod door;
mod examples;
mod gltf;
#[cfg(feature = "internals")]
mod hostile_inputs;
mod layers;
mod make;
mod output;
mod polarisers;
mod program;
mod reference_decoder;
mod relighting;
mod repair;
mod unknown_light;
#[cfg(feature = "internals")]
mod vectors;
mod view;

#[path = "support/markers.rs"]
mod markers;
#[path = "support/stage.rs"]
mod stage;
mod support;
#[path = "support/viewer.rs"]
mod viewer;
