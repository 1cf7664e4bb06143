function answer = packstone_api(method, path, body, file)
%PACKSTONE_API  Sends a request to a Packstone service. MATLAB R2020b or later, or GNU Octave 7, and curl.
%
%   answer = packstone_api('GET', '/v1/jobs/ID')             the answer as a struct
%   answer = packstone_api('POST', '/v1/jobs', request)      sends a struct as JSON
%   packstone_api('GET', '/v1/jobs/ID/result?format=csv', [], 'packing.csv')    saves the answer
%
% The environment variables PACKSTONE_URL and PACKSTONE_API_KEY name the server and the key, if it requires one. What
% the server refuses is an error with its explanation, which names the field, the value and the bound. A file that is
% not made yet is awaited.
%
% curl has the same options in MATLAB and Octave on all systems; webread of Octave 7 takes one header field only.

url = getenv('PACKSTONE_URL');
if isempty(url)
    url = 'http://127.0.0.1:8080';
end
if nargin < 4
    file = tempname();
    remove_file = onCleanup(@() delete_if_there(file));
end
settings = tempname();
remove_settings = onCleanup(@() delete_if_there(settings));

% A file of settings needs no quoting by a shell, and other users do not see the key in a list of processes.
lines = {['url = "' url path '"'], ['request = "' method '"'], ['output = "' slashed(file) '"'], 'silent', ...
    'show-error', 'write-out = "%{http_code}"', 'header = "Prefer: wait=60"', 'max-time = 120'};
key = getenv('PACKSTONE_API_KEY');
if ~isempty(key)
    lines{end + 1} = ['header = "Authorization: Bearer ' key '"'];
end
if nargin > 2 && ~isempty(body)
    sent = tempname();
    remove_sent = onCleanup(@() delete_if_there(sent));
    write_text(sent, jsonencode(body));
    lines = [lines, {'header = "Content-Type: application/json"', ['data-binary = "@' slashed(sent) '"']}];
end
write_text(settings, [strjoin(lines, sprintf('\n')) sprintf('\n')]);

command = ['curl --config "' settings '"'];
if isunix()
    % MATLAB has libraries of its own, with which the curl of the system does not start.
    command = ['LD_LIBRARY_PATH= ' command];
end
code = 202;
while code == 202
    [status, said] = system(command);
    code = str2double(said(max(1, end - 2):end));
    if status ~= 0
        error('packstone:connection', 'no answer from %s: curl ended with %d', url, status);
    end
    % A submission of an export answers 202 with its state; a file is asked for again.
    if code == 202 && nargin < 4
        break
    end
end
if code >= 400
    problem = jsondecode(fileread(file));
    delete_if_there(file);
    error('packstone:refused', '%s', explanation(problem));
end
answer = [];
if nargin < 4
    text = fileread(file);
    if ~isempty(text)
        answer = jsondecode(text);
    end
end
end

function text = explanation(problem)
% One line for each field that the server refuses, or its sentence.
text = problem.detail;
if isfield(problem, 'errors') && ~isempty(problem.errors)
    lines = arrayfun(@(fault) [fault.pointer ': ' fault.detail], problem.errors, 'UniformOutput', false);
    text = strjoin(lines(:)', sprintf('\n'));
end
end

function path = slashed(path)
% In the settings of curl a backslash begins an escape.
path = strrep(path, '\', '/');
end

function write_text(file, text)
out = fopen(file, 'w');
fwrite(out, unicode2native(text, 'UTF-8'));
fclose(out);
end

function delete_if_there(file)
if exist(file, 'file')
    delete(file);
end
end
