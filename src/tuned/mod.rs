//! Profile `tuned`: the photographs' planes, predicted through the mesh from decoded views.

pub mod order;
