/// Last words: what the program says if a library ends it, in place of a stack trace.
///
/// COLMAP lets exceptions out of its threads, as if its database cannot be written. That aborts
/// the process, and nothing of Python runs any more.
#pragma once

#include <algorithm>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <string>

#if !defined(_WIN32)
#include <unistd.h>
#endif

namespace gsfw {

/// The words, where a signal handler may read them: it can take no memory.
struct LastWords {
  char cause[2048];
  char advice[4096];
  int exit_code;
  bool are_set;
  std::terminate_handler terminate;
  void (*abort)(int);
};

inline LastWords last_words = {};

inline void keep_words(char* place, size_t size, const std::string& words) {
  const size_t count = std::min(words.size(), size - 1);
  std::memcpy(place, words.data(), count);
  place[count] = '\0';
}

#if !defined(_WIN32)

inline void say_words(const char* words) {
  for (size_t left = std::strlen(words); left > 0;) {
    const ssize_t said = write(STDERR_FILENO, words, left);
    if (said <= 0) return;
    words += said;
    left -= size_t(said);
  }
}

/// Handler of SIGABRT.
inline void end_with_words(int) {
  say_words(last_words.cause);
  say_words(".\n");
  say_words(last_words.advice);
  _exit(last_words.exit_code);
}

/// Add what an exception says that nobody catches.
[[noreturn]] inline void add_cause() {
  try {
    if (const std::exception_ptr error = std::current_exception()) std::rethrow_exception(error);
  } catch (const std::exception& error) {
    std::string said(error.what());
    said.erase(std::min(said.find_last_not_of(" .\n") + 1, said.size()));
    keep_words(last_words.cause, sizeof last_words.cause,
               std::string(last_words.cause) + ": " + said);
  } catch (...) {
  }
  std::abort();
}

#endif

/// Say something in place of a stack trace if the process aborts, and end with an exit code.
inline void set_last_words(const std::string& cause, const std::string& advice, int exit_code) {
#if !defined(_WIN32)
  keep_words(last_words.cause, sizeof last_words.cause, cause);
  keep_words(last_words.advice, sizeof last_words.advice, advice);
  last_words.exit_code = exit_code;
  if (last_words.are_set) return;
  last_words.are_set = true;
  last_words.terminate = std::set_terminate(&add_cause);
  last_words.abort = std::signal(SIGABRT, &end_with_words);
#endif
}

/// Let the process abort as it did before.
inline void clear_last_words() {
#if !defined(_WIN32)
  if (!last_words.are_set) return;
  last_words.are_set = false;
  std::set_terminate(last_words.terminate);
  std::signal(SIGABRT, last_words.abort);
#endif
}

}  // namespace gsfw
