% Makes surface meshes of the grains and of the matrix, reads their triangles, and compares volumes.
%
%   octave-cli packstone_mesh.m        or, in MATLAB, packstone_mesh
%
% examples/notebooks/mesh.ipynb does the same in Python. `format=msh` is for Gmsh, which fills the surfaces.

%% Pack
request = struct();
request.specimen = struct('type', 'box', 'size_mm', [40 40 40]);
request.mix.grading = struct('type', 'standard', 'name', 'A8');
request.mix.volume_fraction = 0.5;
request.mix.d_min_mm = 4;
request.distance = struct('type', 'constant', 'gap_mm', 0.5);
request.seed = 1;
job = packstone_api('POST', '/v1/jobs', request);
job = packstone_wait(['/v1/jobs/' job.id]);

%% Make the mesh
% The zip has a binary STL for each phase.
packstone_api('GET', ['/v1/jobs/' job.id '/exports/mesh?format=stl&segments=8'], [], 'mesh.zip');
unzip('mesh.zip', 'mesh');

%% Read the triangles of the grains
% A head of 80 bytes, the number of triangles, and 50 bytes for each: normal, three corners, two bytes that are unused.
in = fopen(fullfile('mesh', 'aggregates.stl'), 'r', 'ieee-le');
fseek(in, 80, 'bof');
triangles = fread(in, 1, 'uint32');
corners = zeros(9, triangles);
for k = 1:triangles
    values = fread(in, 12, 'single');
    corners(:, k) = values(4:12);
    fseek(in, 2, 'cof');
end
fclose(in);

%% Check
% The volume below a closed surface is a sum over its triangles.
volume = sum(dot(corners(1:3, :), cross(corners(4:6, :), corners(7:9, :)))) / 6;
expected = job.result.summary.volume_fraction_effective * job.result.summary.specimen_volume_mm3;
assert(abs(volume / expected - 1) < 1e-5);
fprintf('the grains have %.1f mm3, their surfaces %.1f mm3\n', expected, volume);
fprintf('result: %d triangles of %d grains\n', triangles, job.result.summary.grains);
