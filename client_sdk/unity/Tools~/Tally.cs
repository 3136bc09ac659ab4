using System;

namespace Terraport.Tools
{
    /// <summary>Counts cases, and prints <c>N passed, N failed</c> at the end.</summary>
    internal sealed class Tally
    {
        private int passed;
        private int failed;

        /// <summary>Count a case; <paramref name="failure"/> is null where it passed.</summary>
        public void Add(string name, string failure)
        {
            if (failure == null)
            {
                passed++;
                return;
            }
            failed++;
            Console.WriteLine("failed: " + name + ": " + failure);
        }

        /// <summary>Name a case that this client does not take part in.</summary>
        public void Decline(string name, string reason) { Console.WriteLine("declined: " + name + ": " + reason); }

        /// <summary>Print the totals; returns the exit code.</summary>
        public int Finish()
        {
            Console.WriteLine(passed + " passed, " + failed + " failed");
            return failed == 0 && passed > 0 ? 0 : 1;
        }
    }
}
