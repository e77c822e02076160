# find_package(lpvbake) gives lpvbake::lpvbake. Its headers name glm alone; all other packages stay
# inside the library.
include(CMakeFindDependencyMacro)
find_dependency(glm)
include("${CMAKE_CURRENT_LIST_DIR}/lpvbakeTargets.cmake")
