// isolux._core: the compiled solver, arrays in and arrays out.
#include <nanobind/nanobind.h>

void bind_authored_mesh(nanobind::module_& module);
void bind_direct_lighting(nanobind::module_& module);
void bind_mesh_refinement(nanobind::module_& module);
void bind_photometry(nanobind::module_& module);
void bind_photons(nanobind::module_& module);
void bind_progressive_radiosity(nanobind::module_& module);
void bind_ray_caster(nanobind::module_& module);
void bind_scene(nanobind::module_& module);
void bind_final_gather(nanobind::module_& module);
void bind_subdivision(nanobind::module_& module);
void bind_tone_mapping(nanobind::module_& module);

NB_MODULE(_core, module) {
    module.doc() = "The compiled part of Isolux: photometry, ray casting and the solver's "
                   "components over arrays.";
    module.attr("version") = ISOLUX_VERSION;
    bind_authored_mesh(module);
    bind_photometry(module);
    bind_ray_caster(module);
    bind_tone_mapping(module);
    bind_scene(module);
    bind_photons(module);
    bind_direct_lighting(module);
    bind_mesh_refinement(module);
    bind_progressive_radiosity(module);
    bind_final_gather(module);
    bind_subdivision(module);
}
