% Packs three volume fractions by two methods with three seeds each, and prints the success rates.
%
%   octave-cli packstone_study.m       or, in MATLAB, packstone_study
%
% examples/notebooks/study.ipynb does the same in Python.

%% Submit
template = struct();
template.specimen = struct('type', 'box', 'size_mm', [40 40 40]);
template.mix.grading = struct('type', 'standard', 'name', 'A8');
template.mix.volume_fraction = 0.5;
template.mix.d_min_mm = 2;
template.method.type = 'auto';

% A JSON pointer is not a name of a field of a struct, so the grid is a map.
grid_values = containers.Map();
grid_values('/mix/volume_fraction') = [0.5 0.7 0.9];
grid_values('/method/type') = {'rsa', 'edmd'};

request = struct('name', 'A8 by two methods', 'seed', 1, 'replicates', 3);
request.template = template;
request.grid = grid_values;
study = packstone_api('POST', '/v1/studies', request);
address = ['/v1/studies/' study.id];
study = packstone_wait(address);

%% The table
% One row for each volume fraction and method.
table = packstone_api('GET', [address '/table?format=json']);
for k = 1:numel(table.rows)
    row = table.rows(k);
    fprintf('%d of %d succeeded, %.1f grains, volume fraction %.4f\n', row.successes, row.runs, row.grains, ...
        row.volume_fraction_effective);
end
packstone_api('GET', [address '/plots/success'], [], 'success.svg');

%% The packings
% The result of each job is at /v1/jobs/ID/result, as packstone_pack.m reads it.
jobs = packstone_api('GET', [address '/jobs?state=succeeded&limit=100']);
grains = arrayfun(@(job) job.result.summary.grains, jobs.items);
fprintf('result: %d jobs succeeded, %d grains\n', study.counts.succeeded, sum(grains));
