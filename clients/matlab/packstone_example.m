% Submits a study of three volume fractions, two methods and five seeds, waits for it, reads its table, and reads one
% of the packings into arrays. MATLAB R2020b or later, no toolbox.
%
% The environment variables PACKSTONE_URL and PACKSTONE_API_KEY name the server and the key, if it requires one. If the
% server refuses a request, MATLAB shows the status only. clients/curl/study.sh shows the explanation of the server,
% which names the field, the value and the bound.

url = getenv('PACKSTONE_URL');
if isempty(url)
    url = 'http://127.0.0.1:8080';
end
fields = {'Accept', '*/*'};
key = getenv('PACKSTONE_API_KEY');
if ~isempty(key)
    fields = [fields; {'Authorization', ['Bearer ' key]}];
end

%% Submit
job.specimen = struct('type', 'box', 'size_mm', [60 60 60]);
job.mix.grading = struct('type', 'standard', 'name', 'A16');
job.mix.d_min_mm = 4;
job.mix.volume_fraction = 0.65;
job.distance = struct('type', 'constant', 'gap_mm', 0.5);
job.method.type = 'auto';

% A JSON pointer is not a valid name of a struct field, so the grid is a map. A list of one value must be a cell array,
% {0.5}, because jsonencode writes [0.5] as a number.
grid_values = containers.Map();
grid_values('/mix/volume_fraction') = [0.55 0.65 0.75];
grid_values('/method/type') = {'rsa', 'edmd'};

request.name = 'A16 by two methods';
request.seed = 1;
request.template = job;
request.grid = grid_values;
request.replicates = 5;

% The request is encoded here: webwrite sends text as it is.
post_options = weboptions('RequestMethod', 'post', 'MediaType', 'application/json', 'ContentType', 'json', ...
    'HeaderFields', fields, 'Timeout', 60);
study = webwrite([url '/v1/studies'], jsonencode(request), post_options);
study_url = [url '/v1/studies/' study.id];
fprintf('submitted as %s\n', study.id);

%% Wait
% The server holds each answer back until the study has ended, or for a minute.
wait_options = weboptions('ContentType', 'json', 'HeaderFields', [fields; {'Prefer', 'wait=60'}], 'Timeout', 90);
while isempty(study.finished_at)
    study = webread(study_url, wait_options);
    fprintf('%d succeeded, %d failed, of %d\n', study.counts.succeeded, study.counts.failed, study.jobs);
end

%% The table
% One row per volume fraction and method. It is read from a file, because readtable keeps the names of the columns.
file_options = weboptions('HeaderFields', fields, 'Timeout', 60);
websave('table.csv', [study_url '/table?format=csv'], file_options);
rows = readtable('table.csv', 'Delimiter', ',', 'VariableNamingRule', 'preserve');
disp(rows(:, {'/mix/volume_fraction', '/method/type', 'runs', 'successes', 'success_rate', 'time_s_median'}));
websave('success.svg', [study_url '/plots/success'], file_options);

%% One packing, as arrays
json_options = weboptions('ContentType', 'json', 'HeaderFields', fields, 'Timeout', 60);
page = webread([study_url '/jobs?state=succeeded&sort=created&limit=1'], json_options);
websave('packing.csv', [url '/v1/jobs/' page.items(1).id '/result?format=csv'], file_options);
spheres = readmatrix('packing.csv');
x = spheres(:, 1);
y = spheres(:, 2);
z = spheres(:, 3);
d = spheres(:, 4);
fprintf('%d grains; the largest, of %.3f mm, lies at (%.3f, %.3f, %.3f) mm\n', numel(d), d(1), x(1), y(1), z(1));
