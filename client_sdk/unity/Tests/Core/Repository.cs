using System;
using System.IO;
using NUnit.Framework;

namespace Terraport.Tests
{
    /// <summary>Files of the repository that tests read: the conformance corpus.</summary>
    internal static class Repository
    {
        /// <summary>
        /// A path below the repository's root: the folder that TERRAPORT_REPOSITORY names, else the nearest one above the working
        /// directory. Ends the test as ignored where the package was installed without the repository.
        /// </summary>
        internal static string PathTo(string relative)
        {
            string named = Environment.GetEnvironmentVariable("TERRAPORT_REPOSITORY");
            string folder = string.IsNullOrEmpty(named) ? Directory.GetCurrentDirectory() : named;
            for (; folder != null; folder = Path.GetDirectoryName(folder))
            {
                string path = Path.Combine(folder, relative);
                if (Directory.Exists(path) || File.Exists(path))
                {
                    return path;
                }
            }
            Assert.Ignore("no " + relative + " above " + Directory.GetCurrentDirectory() + "; set TERRAPORT_REPOSITORY");
            return null;
        }
    }
}
