// Runs examples/unity on unity_stubs.cs as the programs would, and writes what they would get, a line a
// probe or texture: see unity_test.py, which compares it.
using System;
using System.Collections.Generic;
using System.Globalization;
using System.IO;
using System.Linq;
using System.Reflection;
using Lpvbake;
using Unity.Collections;
using UnityEditor;
using UnityEditor.AssetImporters;
using UnityEngine;
using UnityEngine.Rendering;
using VRCLightVolumes;

static class UnityRun
{
    static void Print(params object[] values)
    {
        Console.WriteLine(string.Join(" ", values.Select(v => v is float ? ((float)v).ToString("R", CultureInfo.InvariantCulture)
                                                                        : Convert.ToString(v, CultureInfo.InvariantCulture))));
    }

    static void Invoke(object on, Type type, string method, params object[] arguments)
    {
        MethodInfo found = type.GetMethod(method, BindingFlags.NonPublic | BindingFlags.Instance | BindingFlags.Static);
        found.Invoke(on, arguments);
    }

    static Vector3[] Positions(string file)
    {
        return File.ReadAllLines(file).Select(line =>
        {
            float[] p = line.Split(' ').Select(n => float.Parse(n, CultureInfo.InvariantCulture)).ToArray();
            return new Vector3(p[0], p[1], p[2]);
        }).ToArray();
    }

    /// Adaptive Probe Volumes: a line of 27 coefficients, colour by colour, validity and occlusion each.
    static int Probes(Vector3[] positions)
    {
        Invoke(null, typeof(LpvbakeProbeBaker), "Use");
        AdaptiveProbeVolumes.LightingBaker baker = AdaptiveProbeVolumes.Baker;
        baker.Initialize(true, new NativeArray<Vector3>(positions, Allocator.Temp), default(NativeArray<uint>));
        while (baker.currentStep < baker.stepCount)
            if (!baker.Step())
                return 1;
        for (int i = 0; i < positions.Length; ++i)
        {
            var line = new List<object>();
            for (int c = 0; c < 3; ++c)
                for (int k = 0; k < 9; ++k)
                    line.Add(baker.irradiance[i][c, k]);
            line.Add(baker.validity[i]);
            line.Add(baker.occlusion[i].x);
            Print(line.ToArray());
        }
        baker.Dispose();
        Invoke(null, typeof(LpvbakeProbeBaker), "UseUnity");
        return AdaptiveProbeVolumes.Baker == null ? 0 : 1;
    }

    /// VRC Light Volumes, two of them: a line of l0, l1r, l1g, l1b and validity each.
    static int Vrc(Vector3[] positions)
    {
        int first = positions.Length / 3;
        var manager = new LightVolumeManager
        {
            Volumes = new[] { positions.Take(first).ToArray(), positions.Skip(first).ToArray() }
        };
        LpvbakeVrcBaker.Bake(manager, LpvbakeSettings.Program, LpvbakeSettings.Scene, LpvbakeSettings.Options);
        for (int id = 0; id < 2; ++id)
        {
            object[] baked = manager.Baked[id];
            for (int i = 0; i < manager.Volumes[id].Length; ++i)
            {
                var line = new List<object>();
                for (int a = 0; a < 4; ++a)
                {
                    Vector3 v = ((Vector3[])baked[a])[i];
                    line.AddRange(new object[] { v.x, v.y, v.z });
                }
                line.Add(((float[])baked[4])[i]);
                Print(line.ToArray());
            }
        }
        return 0;
    }

    /// Imports NAME.unity.json: "texture NAME W H D FORMAT FILE" of each that shaders get, whose texels are in
    /// FILE (of pictures "picture NAME COLUMNS ROWS ..."), "scale ...", "offset ...", or "error ...".
    static int Import(string json, string folder)
    {
        Invoke(null, typeof(LpvbakePictures), "OnPostprocessAllAssets", new[] { json }, new string[0], new string[0], new string[0]);
        if (AssetDatabase.GetImporterOverride(json) != typeof(LpvbakeImporter))
            return 1;
        foreach (string picture in Directory.GetFiles(Path.GetDirectoryName(json), "*.exr"))
        {
            var importer = new TextureImporter();
            Invoke(new LpvbakePictures { assetPath = picture, assetImporter = importer }, typeof(LpvbakePictures), "OnPreprocessTexture");
            if (importer.Settings == null)
                continue;
            TextureImporterSettings s = importer.Settings;
            Print("picture", Path.GetFileName(picture), s.flipbookColumns, s.flipbookRows, s.textureShape, s.sRGBTexture,
                  s.mipmapEnabled, s.npotScale, s.wrapMode, s.filterMode, importer.textureCompression);
            AssetDatabase.Assets[picture] = new Texture3D(1, 1, 1, TextureFormat.RGBAHalf, false) { name = Path.GetFileNameWithoutExtension(picture) };
        }
        var context = new AssetImportContext { assetPath = json };
        new LpvbakeImporter().OnImportAsset(context);
        foreach (string error in context.Errors)
            Print("error", error);
        var volume = context.Main as LpvbakeVolume;
        if (volume == null)
            return 0;
        var light = new LpvbakeLight { volume = volume, intensity = 0.5f };
        Invoke(light, typeof(LpvbakeLight), "OnEnable");
        foreach (KeyValuePair<string, object> global in Shader.Globals.OrderBy(pair => pair.Key))
        {
            var texture = global.Value as Texture3D;
            if (texture != null)
            {
                string file = Path.Combine(folder, global.Key);
                File.WriteAllBytes(file, texture.Data ?? new byte[0]);
                Print("texture", global.Key, texture.Size[0], texture.Size[1], texture.Size[2], texture.Format, texture.name);
                continue;
            }
            var vector = (Vector4)global.Value;
            Print(global.Key, vector.x, vector.y, vector.z, vector.w);
        }
        foreach (string dependency in context.Dependencies)
            Print("depends", dependency);
        return 0;
    }

    static int Main(string[] a)
    {
        if (a[0] == "import")
            return Import(a[1], a[2]);
        LpvbakeSettings.Program = a[1];
        LpvbakeSettings.Scene = a[2];
        LpvbakeSettings.Options = a[3];
        return a[0] == "probes" ? Probes(Positions(a[4])) : Vrc(Positions(a[4]));
    }
}
