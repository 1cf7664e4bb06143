% Makes a lattice discrete particle model, and reads its nodes and tetrahedra.
%
%   octave-cli packstone_lattice.m     or, in MATLAB, packstone_lattice
%
% examples/notebooks/lattice.ipynb does the same in Python.

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

%% Make the lattice
% The zip has text files for Project Chrono.
packstone_api('GET', ['/v1/jobs/' job.id '/exports/ldpm?format=chrono'], [], 'lattice.zip');
unzip('lattice.zip', 'lattice');
% Lines that begin with // are comments, and indices count from zero.
in = fopen(fullfile('lattice', 'ldpm-data-nodes.dat'));
columns = textscan(in, '%f %f %f', 'CommentStyle', '//');
fclose(in);
nodes = [columns{:}];
in = fopen(fullfile('lattice', 'ldpm-data-tets.dat'));
columns = textscan(in, '%f %f %f %f', 'CommentStyle', '//');
fclose(in);
tetrahedra = [columns{:}] + 1;

%% Check
% The tetrahedra fill the cube.
a = nodes(tetrahedra(:, 1), :);
edge = @(k) nodes(tetrahedra(:, k), :) - a;
volume = sum(dot(edge(2), cross(edge(3), edge(4), 2), 2)) / 6;
assert(abs(volume / 40^3 - 1) < 1e-9);
fprintf('the tetrahedra have %.1f mm3, the cube %.1f mm3\n', volume, 40^3);
fprintf('result: %d nodes, %d tetrahedra\n', size(nodes, 1), size(tetrahedra, 1));
