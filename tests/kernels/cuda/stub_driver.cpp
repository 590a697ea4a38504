// A driver without a GPU: the calls that gsfw.kernels.cuda.driver makes, recorded and checked.
//
// Like the real one it has a current context per thread, refuses modules and launches without one,
// and copies a kernel's structure while it is launched.
#include <cstdint>
#include <cstring>
#include <map>
#include <mutex>
#include <string>

namespace {

enum Status { SUCCESS = 0, INVALID_VALUE = 1, NO_DEVICE = 100, INVALID_IMAGE = 200, INVALID_CONTEXT = 201 };

std::mutex mutex;
std::string calls;
std::map<std::string, int> failures;
int version = 13000;
int shared_bytes = 0;
size_t job_size = 0;
std::string job;
thread_local void* current = nullptr;

int record(const char* name, const std::string& arguments = "") {
  std::lock_guard<std::mutex> lock(mutex);
  calls += std::string(name) + "(" + arguments + ")\n";
  auto found = failures.find(name);
  return found == failures.end() ? SUCCESS : found->second;
}

}  // namespace

extern "C" {

// What tests use.

void stub_reset(int driver_version) {
  calls.clear();
  failures.clear();
  version = driver_version;
  shared_bytes = 0;
  current = nullptr;
}

void stub_fail(const char* name, int status) { failures[name] = status; }

void stub_expect_job(size_t size) { job_size = size; }

void stub_share(int bytes) { shared_bytes = bytes; }

const char* stub_job() { return job.data(); }

const char* stub_calls() { return calls.c_str(); }

// What the driver has.

int cuInit(unsigned flags) { return record("cuInit", std::to_string(flags)); }

int cuDriverGetVersion(int* out) {
  *out = version;
  return record("cuDriverGetVersion");
}

int cuCtxGetCurrent(void** out) {
  *out = current;
  return record("cuCtxGetCurrent");
}

int cuDeviceGet(int* out, int ordinal) {
  *out = ordinal;
  return record("cuDeviceGet", std::to_string(ordinal));
}

int cuDevicePrimaryCtxRetain(void** out, int device) {
  *out = reinterpret_cast<void*>(uintptr_t(0x7fff00001000) + uintptr_t(device));
  return record("cuDevicePrimaryCtxRetain", std::to_string(device));
}

int cuCtxSetCurrent(void* context) {
  current = context;
  return record("cuCtxSetCurrent", std::to_string(reinterpret_cast<uintptr_t>(context) & 0xfff));
}

int cuModuleLoadData(void** out, const void* image) {
  const char* text = static_cast<const char*>(image);
  bool machine_code = std::memcmp(text, "\x7f" "ELF", 4) == 0;
  bool ptx = !machine_code && std::strstr(text, ".entry") != nullptr;
  int status = record("cuModuleLoadData", machine_code ? "cubin" : ptx ? "ptx" : "?");
  if (status != SUCCESS) return status;
  if (current == nullptr) return INVALID_CONTEXT;
  *out = reinterpret_cast<void*>(uintptr_t(0x7fff00002000));
  return machine_code || ptx ? SUCCESS : INVALID_IMAGE;
}

int cuModuleGetFunction(void** out, void* module, const char* name) {
  int status = record("cuModuleGetFunction", name);
  if (module != reinterpret_cast<void*>(uintptr_t(0x7fff00002000))) return INVALID_VALUE;
  *out = reinterpret_cast<void*>(uintptr_t(0x7fff00003000));
  return status;
}

int cuFuncGetAttribute(int* out, int attribute, void* function) {
  int status = record("cuFuncGetAttribute", std::to_string(attribute));
  if (function != reinterpret_cast<void*>(uintptr_t(0x7fff00003000))) return INVALID_VALUE;
  *out = shared_bytes;
  return status;
}

int cuFuncSetAttribute(void* function, int attribute, int value) {
  int status = record("cuFuncSetAttribute", std::to_string(attribute) + " " + std::to_string(value));
  if (function != reinterpret_cast<void*>(uintptr_t(0x7fff00003000))) return INVALID_VALUE;
  return status;
}

int cuLaunchKernel(void* function, unsigned grid_x, unsigned grid_y, unsigned grid_z,
                   unsigned block_x, unsigned block_y, unsigned block_z, unsigned shared,
                   void* stream, void** parameters, void** extra) {
  std::string arguments;
  for (unsigned number : {grid_x, grid_y, grid_z, block_x, block_y, block_z, shared}) {
    arguments += std::to_string(number) + " ";
  }
  arguments += "stream " + std::to_string(reinterpret_cast<uintptr_t>(stream));
  int status = record("cuLaunchKernel", arguments);
  if (status != SUCCESS) return status;
  if (current == nullptr) return INVALID_CONTEXT;
  if (function != reinterpret_cast<void*>(uintptr_t(0x7fff00003000)) || extra != nullptr) {
    return INVALID_VALUE;
  }
  job.assign(static_cast<const char*>(parameters[0]), job_size);
  return SUCCESS;
}

int cuGetErrorName(int status, const char** out) {
  *out = status == INVALID_IMAGE ? "CUDA_ERROR_INVALID_IMAGE" : status == 700 ? "CUDA_ERROR_ILLEGAL_ADDRESS" : nullptr;
  return SUCCESS;
}

int cuGetErrorString(int status, const char** out) {
  *out = status == INVALID_IMAGE ? "device kernel image is invalid" : status == 700 ? "an illegal memory access was encountered" : nullptr;
  return SUCCESS;
}

}  // extern "C"
